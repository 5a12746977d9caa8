/* The serial line: 250 kbaud, 8N1, by interrupts and static ring buffers. */
#ifndef UART_H
#define UART_H

#include <stdbool.h>
#include <stdint.h>

#include "clock.h"

void uart_start(void);

/* The next received character. NUL marks a place where characters were lost, or one that was garbled. */
bool uart_read(char *character);

/* Whether characters wait. */
bool uart_has_received(void);

/* The tick at which the last `\n` from `uart_read` was received, within 4 ms of its reception. */
tick_t uart_newline_tick(void);

/* Whether the last stop bit has left. */
bool uart_is_idle(void);

/* Send a line's first character, the transmitter being idle. Returns the tick at which it begins (to one bit, 4 µs). */
tick_t uart_begin(char first);

/* Send a further one. A line of at most 120 characters and its end fits into the buffer. */
void uart_send(char character);

#endif
