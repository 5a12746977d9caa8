/* The serial line: 250 kbaud, 8N1, by interrupts and static rings. */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stdint.h>

#include "clock.h"

void uart_start(void);

/* The next received character. One that was garbled, or before which others were lost, is NUL. */
bool uart_read(char *character);

/* Whether characters wait. */
bool uart_has_received(void);

/* The tick by which the `\n` that `uart_read` has just given was received: that of its reception, if it is the last one
 * and not older than 4 ms, else now. */
tick_t uart_newline_tick(void);

/* Whether the last stop bit has left. */
bool uart_is_idle(void);

/* Send a line's first character, the transmitter being idle. Returns the tick at which it begins (to one bit, 4 µs). */
tick_t uart_begin(char first);

/* Send a further one. A whole line fits into the ring. */
void uart_send(char character);

#endif
