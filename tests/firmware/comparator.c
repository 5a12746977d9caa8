// SPDX-License-Identifier: GPL-3.0-or-later
// The loop's voltage, the comparator (23), the input capture (16.6), and what simavr's Timer1 lacks.
#include "chip.h"

enum { ANALOG_DELAY = 8 };    // comparator's propagation delay: 500 ns at 4 V (31.8)
enum { CAPTURE_DELAY = 3 };   // synchroniser and edge detector: 2.5 to 3.5 cycles (16.3)
enum { CANCELLER_DELAY = 4 }; // noise canceller: four equal samples (16.6.2)

static struct { cycles when; uint16_t millivolts; } levels[QUEUE];
static unsigned levels_in, levels_out;
uint16_t millivolts, bandgap_mv = 1100;
avr_timer_t *timer1;
static avr_int_vector_t comparator_vector;
static bool comparator_output, comparator_next, capture_rising;
static uint8_t temp;  // the high byte that Timer1's 16-bit registers share

static bool compared(void) {
    uint8_t acsr = avr->data[ACSR_];
    if (acsr & ACD) return false;
    bool other_input = (avr->data[ADCSRB_] & ACME) && !(avr->data[ADCSRA_] & ADEN);
    if (!(acsr & ACBG) || other_input) fail("the comparator's inputs are not bandgap and loop");
    return bandgap_mv > millivolts;
}

static void compare(cycles when) {
    if (avr->data[ACSR_] & ACBG) {
        comparator_next = compared();
        if (comparator_next != comparator_output) {
            if (due[COMPARATOR] == NEVER) set_due(COMPARATOR, when + ANALOG_DELAY);
        } else {
            set_due(COMPARATOR, NEVER);  // a pulse shorter than the delay
        }
    }
}

void switch_comparator(cycles when) {
    comparator_output = comparator_next;
    uint8_t acsr = avr->data[ACSR_], mode = acsr & 3;
    if (mode == 0 || (mode == 2 && !comparator_output) || (mode == 3 && comparator_output)) {
        avr->data[ACSR_] |= ACI;
        raise_if(&comparator_vector, acsr & ACIE);
    }
    if (acsr & ACIC) {
        bool cancel = avr->data[TCCR1B_] & ICNC1;
        // with the canceller a pulse of less than four cycles is none
        if (due[CAPTURE] != NEVER && cancel && due[CAPTURE] > when + CAPTURE_DELAY)
            set_due(CAPTURE, NEVER);
        else {
            capture_rising = comparator_output;
            set_due(CAPTURE, when + CAPTURE_DELAY + (cancel ? CANCELLER_DELAY : 0));
        }
    }
}

void capture(cycles when) {
    uint8_t tccr1b = avr->data[TCCR1B_];
    if (!(avr->data[ACSR_] & ACIC) || capture_rising != !!(tccr1b & ICES1)) return;
    if (!timer1->tov_cycles) return;
    int64_t since = (int64_t)(when - timer1->tov_base);
    uint16_t count = (since + (int64_t)timer1->tov_cycles) * (timer1->tov_top + 1) / (int64_t)timer1->tov_cycles;
    avr->data[ICR1L_] = count;
    avr->data[ICR1H_] = count >> 8;
    avr_raise_interrupt(avr, &timer1->icr);
}

static uint8_t read_acsr(avr_t *core, avr_io_addr_t address, void *unused) {
    (void)unused;
    return (core->data[address] & ~ACO) | (comparator_output ? ACO : 0);
}

static void write_acsr(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    uint8_t flag = core->data[address] & ACI & ~value;
    core->data[address] = (value & ~(ACO | ACI)) | flag;
    raise_if(&comparator_vector, flag && (value & ACIE));
    compare(core->cycle);
}

static void write_tifr1(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;  // simavr clears every flag, whatever is written
    avr_int_vector_t *vectors[] = {&timer1->overflow, &timer1->comp[0].interrupt, &timer1->comp[1].interrupt, &timer1->icr};
    for (int i = 0; i < 4; i++)
        if (value & core->data[address] & 1 << vectors[i]->raised.bit) avr_clear_interrupt(core, vectors[i]);
}

static struct { avr_io_read_t read; avr_io_write_t write_a, write_b; void *timer, *a, *b; } of_timer1;

static uint8_t read_low(avr_t *core, avr_io_addr_t address, void *unused) {
    (void)unused;
    uint8_t low = address == TCNT1L_ ? of_timer1.read(core, address, of_timer1.timer) : core->data[address];
    temp = core->data[address + 1];
    return low;
}

static uint8_t read_high(avr_t *core, avr_io_addr_t address, void *unused) {
    (void)core, (void)address, (void)unused;
    return temp;
}

static void write_high(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)core, (void)address, (void)unused;
    temp = value;
}

static void write_low(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    core->data[address + 1] = temp;
    if (address == OCR1AL_) of_timer1.write_a(core, address, value, of_timer1.a);
    else of_timer1.write_b(core, address, value, of_timer1.b);
}

void add_level(cycles when, uint16_t level_mv) {
    if (levels_in - levels_out == QUEUE) fail("too many levels wait");
    levels[levels_in % QUEUE].when = when;
    levels[levels_in++ % QUEUE].millivolts = level_mv;
    if (levels_in - levels_out == 1) set_due(LEVEL, when);
}

void next_level(cycles when) {
    millivolts = levels[levels_out++ % QUEUE].millivolts;
    set_due(LEVEL, levels_out == levels_in ? NEVER : levels[levels_out % QUEUE].when);
    compare(when);
}

void comparator_reset(void) {
    comparator_output = comparator_next = false;
    set_due(COMPARATOR, NEVER);
    set_due(CAPTURE, NEVER);
}

void comparator_take_over(void) {
    avr_int_vector_t *theirs = &((avr_acomp_t *)module_of("ac", 0))->ac;
    comparator_vector = (avr_int_vector_t){.vector = theirs->vector, .enable = theirs->enable, .raised = theirs->raised};
    theirs->vector = 0;  // simavr's own comparator raises nothing
    avr_register_vector(avr, &comparator_vector);
    timer1 = module_of("timer", '1');
    avr_ioport_getirq_t pin = {.bit = timer1->icp};  // with ACIC the capture does not look at its pin
    if (avr_ioctl(avr, AVR_IOCTL_IOPORT_GETIRQ_REGBIT, &pin) > 0)
        avr_unconnect_irq(pin.irq[0], timer1->io.irq + TIMER_IRQ_IN_ICP);
    timer1->icp.reg = 0;
    of_timer1.read = avr->io[AVR_DATA_TO_IO(TCNT1L_)].r.c, of_timer1.timer = avr->io[AVR_DATA_TO_IO(TCNT1L_)].r.param;
    of_timer1.write_a = avr->io[AVR_DATA_TO_IO(OCR1AL_)].w.c, of_timer1.a = avr->io[AVR_DATA_TO_IO(OCR1AL_)].w.param;
    of_timer1.write_b = avr->io[AVR_DATA_TO_IO(OCR1BL_)].w.c, of_timer1.b = avr->io[AVR_DATA_TO_IO(OCR1BL_)].w.param;
    take(TCNT1L_, read_low, NULL), take(TCNT1H_, read_high, NULL);
    take(ICR1L_, read_low, NULL), take(ICR1H_, read_high, NULL);
    take(OCR1AL_, NULL, write_low), take(OCR1AH_, NULL, write_high);
    take(OCR1BL_, NULL, write_low), take(OCR1BH_, NULL, write_high);
    take(TIFR1_, NULL, write_tifr1);
    take(ACSR_, read_acsr, write_acsr);
}
