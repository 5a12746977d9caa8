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
    uint16_t cycles = at.cycles - earlier;
    return at.overflows * (0x10000 / CYCLES_PER_TICK) + cycles / CYCLES_PER_TICK;
}
