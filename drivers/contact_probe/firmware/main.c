/* Firmware of the contact probe for the ATmega328P: start, main loop, watchdog. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/power.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "clock.h"
#include "loop.h"
#include "probe.h"
#include "uart.h"

static uint8_t reset_flags __attribute__((section(".noinit")));

/* Before the variables are set. After a watchdog reset the watchdog runs on at 16 ms until its flag is cleared. */
static void read_reset_flags(void) __attribute__((naked, used, section(".init3")));
static void read_reset_flags(void)
{
    reset_flags = MCUSR;
    MCUSR = 0;
    wdt_enable(WDTO_60MS);
}

/* Flags add up until they are cleared: power-on sets the brown-out's, too, and a boot loader ends by a watchdog reset
 * after the external one. A boot loader that clears them leaves none: EXTERNAL. */
static enum cause cause_of(uint8_t flags)
{
    if (flags & _BV(PORF))
        return CAUSE_POWER;
    if (flags & _BV(BORF))
        return CAUSE_BROWNOUT;
    if ((flags & (_BV(EXTRF) | _BV(WDRF))) == _BV(WDRF))
        return CAUSE_WATCHDOG;
    return CAUSE_EXTERNAL;
}

/* Unused inputs have their pull-ups on, unused parts no clock: less noise beside the comparator. */
static void quieten(void)
{
    PORTB = (uint8_t)~_BV(PB5);
    PORTC = (uint8_t)~_BV(PC0);
    PORTD = (uint8_t)~(_BV(PD4) | _BV(PD7));
    PRR = _BV(PRTWI) | _BV(PRTIM2) | _BV(PRTIM0) | _BV(PRSPI);
}

/* Until the next interrupt, unless one has left work since the last pass. */
static void sleep_if_idle(void)
{
    cli();
    if (!loop_has_news() && !uart_has_received()) {
        sleep_enable();
        sei();
        sleep_cpu(); /* the instruction after `sei` is executed before any interrupt */
        sleep_disable();
    }
    sei();
}

int main(void)
{
    uint8_t samples = 0;
    quieten();
    clock_start();
    loop_start();
    uart_start();
    set_sleep_mode(SLEEP_MODE_IDLE);
    probe_start(cause_of(reset_flags));
    sei();
    for (;;) {
        probe_update();
        if (loop_samples() != samples) { /* the watchdog watches the converter's interrupt, too */
            samples = loop_samples();
            wdt_reset();
        }
        sleep_if_idle();
    }
}
