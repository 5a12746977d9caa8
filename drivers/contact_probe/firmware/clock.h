/* Time: Timer1 counts the 16 MHz of the crystal; a tick is eight cycles. */
#ifndef CLOCK_H
#define CLOCK_H

#include <avr/io.h>
#include <stdbool.h>
#include <stdint.h>

#include "board.h"

/* 2 MHz; wraps to 0 after 35.8 min. */
typedef uint32_t tick_t;

/* The timer's 16 bits, and how often it has overflowed. */
struct instant {
    uint32_t overflows;
    uint16_t cycles;
};

extern volatile uint32_t clock_overflows;

void clock_start(void);

tick_t clock_now(void);

/* The tick that lay `earlier` cycles before the instant. */
tick_t clock_tick(struct instant at, uint16_t earlier);

/* Whether `due`, less than 17 min away, has come. */
static inline bool clock_reached(tick_t now, tick_t due)
{
    return (int32_t)(now - due) >= 0;
}

/* The instant of a count that the timer had less than 2 ms ago. Interrupts are disabled.
 *
 * A count of the lower half with an overflow that still waits for its interrupt was taken after that overflow; a count
 * of the upper half was taken before it. */
static inline __attribute__((always_inline)) struct instant clock_instant(uint16_t cycles)
{
    struct instant at = {clock_overflows, cycles};
    if ((TIFR1 & _BV(TOV1)) && cycles < 0x8000)
        at.overflows++;
    return at;
}

#endif
