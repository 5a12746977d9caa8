#include "clock.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

volatile uint32_t clock_overflows;

ISR(TIMER1_OVF_vect)
{
    clock_overflows++;
}

void clock_start(void)
{
    /* No prescaler: delays of a few cycles can be subtracted from a capture before it becomes a tick. */
    TCCR1B = _BV(CS10);
    TIMSK1 = _BV(TOIE1);
}

tick_t clock_now(void)
{
    struct instant at;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        at = clock_instant(TCNT1);
    }
    return clock_tick(at, 0);
}

tick_t clock_tick(struct instant at, uint16_t earlier)
{
    if (at.cycles < earlier)
        at.overflows--;
    uint32_t low = at.overflows << 16 | (uint16_t)(at.cycles - earlier);
    uint8_t high = (uint8_t)(at.overflows >> 16) << 5; /* 2^32 cycles are 2^29 ticks */
    return low / CYCLES_PER_TICK | (uint32_t)high << 24;
}
