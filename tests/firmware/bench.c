// SPDX-License-Identifier: GPL-3.0-or-later
// (simavr, which this links, has that licence. It is a tool of the tests: nothing that cellctl ships links it.)
//
// The probe's firmware in a simulated ATmega328P at 16 MHz, stepped over stdin and stdout. `bench probe.elf`; one
// command a line; README.md has the list. simavr runs the core, the ports, timers, watchdog and EEPROM. Its UART, A/D
// converter, comparator and input capture differ from the chip (README.md says how), so they are modelled here, from the
// data sheet (DS40002061B, sections named below).

#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <simavr/avr_acomp.h>
#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_core.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_elf.h>
#include <simavr/sim_interrupts.h>

typedef uint64_t cycles;
#define NEVER UINT64_MAX
#define QUEUE 4096

enum {  // addresses in data space
    PINB_ = 0x23, TIFR1_ = 0x36, MCUSR_ = 0x54, TIMSK0_ = 0x6E, TIMSK1_ = 0x6F, TIMSK2_ = 0x70,
    ADCL_ = 0x78, ADCH_ = 0x79, ADCSRA_ = 0x7A, ADCSRB_ = 0x7B, ADMUX_ = 0x7C, ACSR_ = 0x50,
    TCCR1B_ = 0x81, TCNT1L_ = 0x84, TCNT1H_, ICR1L_, ICR1H_, OCR1AL_, OCR1AH_, OCR1BL_, OCR1BH_,
    UCSR0A_ = 0xC0, UCSR0B_ = 0xC1, UBRR0L_ = 0xC4, UBRR0H_ = 0xC5, UDR0_ = 0xC6,
};
enum { RXC = 0x80, TXC = 0x40, UDRE = 0x20, FE = 0x10, DOR = 0x08, U2X = 0x02, RXCIE = 0x80, TXCIE = 0x40, UDRIE = 0x20,
       RXEN = 0x10, TXEN = 0x08 };
enum { ACD = 0x80, ACBG = 0x40, ACO = 0x20, ACI = 0x10, ACIE = 0x08, ACIC = 0x04, ACME = 0x40 };
enum { ADEN = 0x80, ADSC = 0x40, ADATE = 0x20, ADIF = 0x10 };
enum { ICNC1 = 0x80, ICES1 = 0x40 };
enum { PORF = 1, EXTRF = 2, BORF = 4, WDRF = 8 };

enum { ANALOG_DELAY = 8 };    // comparator's propagation delay: 500 ns at 4 V (31.8)
enum { CAPTURE_DELAY = 3 };   // synchroniser and edge detector: 2.5 to 3.5 cycles (16.3)
enum { CANCELLER_DELAY = 4 }; // noise canceller: four equal samples (16.6.2)
enum { ENTRY_CYCLES = 4, WAKE_CYCLES = 4 };  // of an interrupt, and of idle sleep before it (7.7.1)

static avr_t *avr;
static avr_timer_t *timer1;
static avr_uart_t *uart;
static avr_adc_t *adc;
static avr_int_vector_t comparator_vector;
static const char *elf;
static uint32_t watched_vectors;
static bool hung, was_sleeping;

// What is due, one entry for each kind; `run_due` does them in the order of their times.
enum due_kind { LEVEL, RESET, HANG, COMPARATOR, CAPTURE, RECEIVED, SENT, SAMPLED, CONVERTED, KINDS };
static cycles due[KINDS];
static cycles next_due, stop_at;

static void set_due(enum due_kind kind, cycles when) {
    due[kind] = when;
    next_due = NEVER;
    for (int k = 0; k < KINDS; k++)
        if (due[k] < next_due) next_due = due[k];
}

static void fail(const char *text) {
    printf("error %s\n", text);
    fflush(stdout);
    exit(1);
}

// ---- Interrupts: simavr's flags are of the edge; those of the UART are of the level -----------------------------------

static void raise_if(avr_int_vector_t *vector, bool condition) {
    if (condition && !vector->pending) avr_raise_interrupt(avr, vector);
    if (!condition && vector->pending) vector->pending = 0;
}

static void write_mask(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    core->data[address] = value;  // simavr forgets a flag that was raised while its interrupt was off
    for (int i = 0; i < core->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = core->interrupts.vector[i];
        if (vector->enable.reg == address && avr_regbit_get(core, vector->enable) && avr_regbit_get(core, vector->raised))
            raise_if(vector, true);
    }
}

static void on_interrupt(struct avr_irq_t *irq, uint32_t running, void *param) {
    (void)irq;
    avr_int_vector_t *vector = param;
    if (!running) return;
    avr->cycle += ENTRY_CYCLES + (was_sleeping ? WAKE_CYCLES : 0);
    was_sleeping = false;
    if (watched_vectors >> vector->vector & 1) printf("irq %" PRIu64 " %d\n", avr->cycle, vector->vector);
}

// ---- The loop's voltage, the comparator, the capture (23, 16.6) -------------------------------------------------------

static struct { cycles when; uint16_t millivolts; } levels[QUEUE];
static unsigned levels_in, levels_out;
static uint16_t millivolts, bandgap_mv = 1100;
static bool comparator_output, comparator_next, capture_rising;
static uint8_t temp;  // the high byte that Timer1's 16-bit registers share

static bool compared(void) {
    uint8_t acsr = avr->data[ACSR_];
    if (acsr & ACD) return false;
    bool other_input = (avr->data[ADCSRB_] & ACME) && (avr->data[ADCSRA_] & ADEN);
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

static void switch_comparator(cycles when) {
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

static void capture(cycles when) {
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

// ---- UART (20): two-byte buffers, ten bits a byte ---------------------------------------------------------------------

static uint16_t received[3];  // with FRAMING for a byte whose stop bit was not one
#define FRAMING 0x100
static uint8_t received_count;  // the third waits in the shift register
static bool overrun, shifting, sending_full;
static uint8_t sending_next;
static uint8_t wire[1 << 20];   // from the host, on its way
static uint32_t wire_in, wire_out;
static struct { cycles when; uint32_t count; } batches[QUEUE];
static unsigned batches_in, batches_out;
static cycles host_bit_1000 = 64000;  // a bit of the host, in thousandths of a cycle
static cycles wire_free_1000;

static cycles bit_cycles(void) {
    uint32_t ubrr = avr->data[UBRR0L_] | (avr->data[UBRR0H_] & 0xF) << 8;
    return (ubrr + 1) * (avr->data[UCSR0A_] & U2X ? 8 : 16);
}

static void uart_levels(void) {
    uint8_t a = avr->data[UCSR0A_], b = avr->data[UCSR0B_];
    raise_if(&uart->rxc, (a & RXC) && (b & RXCIE));
    raise_if(&uart->udrc, (a & UDRE) && (b & UDRIE) && (b & TXEN));
    raise_if(&uart->txc, (a & TXC) && (b & TXCIE));
}

static void set_flag(uint8_t bit, bool on) {
    avr->data[UCSR0A_] = on ? avr->data[UCSR0A_] | bit : avr->data[UCSR0A_] & ~bit;
}

static void next_from_host(void) {
    while (batches_out != batches_in && batches[batches_out % QUEUE].count == 0) batches_out++;
    if (batches_out == batches_in) return set_due(RECEIVED, NEVER);
    cycles start = 1000 * batches[batches_out % QUEUE].when;
    if (start < wire_free_1000) start = wire_free_1000;
    wire_free_1000 = start + 10 * host_bit_1000;
    // the receiver has the byte in the middle of its stop bit
    set_due(RECEIVED, (wire_free_1000 - host_bit_1000 / 2) / 1000);
}

static void receive(cycles when) {
    uint16_t byte = wire[wire_out++ % sizeof wire];
    // a bit of another length: the last sample is that of a wrong bit once it is half a bit off (20.8.3)
    int64_t off = 19 * ((int64_t)host_bit_1000 - 1000 * (int64_t)bit_cycles());
    if (llabs(off) > 1000 * (int64_t)bit_cycles()) byte = (byte ^ 0xFF) | FRAMING;
    batches[batches_out % QUEUE].count--;
    next_from_host();
    if (!(avr->data[UCSR0B_] & RXEN)) return;
    if (received_count == 3) {  // the one that waits is lost (20.7.4)
        overrun = true;
        printf("overrun %" PRIu64 "\n", when);
        received[2] = byte;
    } else {
        received[received_count++] = byte;
    }
    set_flag(RXC, true);
    set_flag(FE, received[0] & FRAMING);
}

static void shift_out(cycles when, uint8_t byte) {
    printf("tx %" PRIu64 " %02x\n", when, byte);
    shifting = true;
    set_due(SENT, when + 10 * bit_cycles());
}

static void sent(cycles when) {
    set_due(SENT, NEVER);
    if (sending_full) {
        sending_full = false;
        set_flag(UDRE, true);
        shift_out(when, sending_next);
    } else {
        shifting = false;
        set_flag(TXC, true);
    }
}

static uint8_t read_udr(avr_t *core, avr_io_addr_t address, void *unused) {
    (void)core, (void)address, (void)unused;
    uint8_t byte = received[0];
    if (received_count) {
        memmove(received, received + 1, sizeof received - sizeof *received);
        received_count--;
    }
    set_flag(DOR, overrun && received_count < 2);
    if (received_count < 2) overrun = false;
    set_flag(RXC, received_count > 0);
    set_flag(FE, received_count > 0 && (received[0] & FRAMING));
    return byte;
}

static void write_udr(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)address, (void)unused;
    uint8_t a = core->data[UCSR0A_];
    if (!(core->data[UCSR0B_] & TXEN) || !(a & UDRE)) return;
    if (!shifting) {
        shift_out(core->cycle, value);
    } else {
        sending_next = value;
        sending_full = true;
        set_flag(UDRE, false);
    }
}

static void write_ucsra(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    uint8_t fixed = core->data[address] & (RXC | UDRE | FE | DOR | (value & TXC ? 0 : TXC));
    core->data[address] = fixed | (value & 3);
}

static void write_plain(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    core->data[address] = value;
    if (address == UCSR0B_ && !(value & RXEN)) {
        received_count = 0;
        set_flag(RXC, false);
    }
}

// ---- A/D converter (24): the voltage counts at sample and hold, not when the result is read ----------------------------

static bool first_conversion;
static uint16_t sample;

static void convert(cycles now) {
    unsigned power = avr->data[ADCSRA_] & 7;
    cycles clock = power ? 1u << power : 2;
    cycles start = (now + clock - 1) / clock * clock;
    set_due(SAMPLED, start + (first_conversion ? 27 : 3) * clock / 2);
    set_due(CONVERTED, start + (first_conversion ? 25 : 13) * clock);
    first_conversion = false;
}

static void hold_sample(cycles when) {
    (void)when;
    uint8_t admux = avr->data[ADMUX_], channel = admux & 15;
    uint32_t reference = admux >> 6 == 3 ? bandgap_mv : 5000;
    uint32_t input = channel < 8 ? millivolts : channel == 14 ? bandgap_mv : 0;
    uint32_t value = input * 1024 / reference;
    sample = value > 1023 ? 1023 : value;
    if (admux & 0x20) sample <<= 6;
    set_due(SAMPLED, NEVER);
}

static void converted(cycles when) {
    avr->data[ADCL_] = sample;
    avr->data[ADCH_] = sample >> 8;
    avr->data[ADCSRA_] &= ~ADSC;
    set_due(CONVERTED, NEVER);
    avr_raise_interrupt(avr, &adc->adc);
    if (avr->data[ADCSRA_] & ADATE) {
        if (avr->data[ADCSRB_] & 7) fail("the A/D converter's trigger is not modelled");
        avr->data[ADCSRA_] |= ADSC;
        convert(when);
    }
}

static void write_adcsra(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    uint8_t old = core->data[address];
    if (value & ADIF) {
        avr_clear_interrupt(core, &adc->adc);
        value &= ~ADIF;
    } else {
        value |= old & ADIF;
    }
    if (!(value & ADEN)) {
        set_due(SAMPLED, NEVER);
        set_due(CONVERTED, NEVER);
        core->data[address] = value & ~ADSC;
        return;
    }
    if (!(old & ADEN)) first_conversion = true;
    core->data[address] = value | (old & ADSC);
    if ((value & ADSC) && !(old & ADSC)) convert(core->cycle);
    raise_if(&adc->adc, (core->data[address] & ADIF) && avr_regbit_get(core, adc->adc.enable));
}

static uint8_t read_plain(avr_t *core, avr_io_addr_t address, void *unused) {
    (void)unused;
    return core->data[address];
}

// ---- Reset, and one step ----------------------------------------------------------------------------------------------

static uint8_t reset_flag;
static bool reset_waits;

static void begin(uint8_t flag) {
    avr->data[MCUSR_] |= flag;
    avr->data[UCSR0A_] = UDRE;
    avr->data[UCSR0B_] = 0;
    received_count = 0;
    overrun = shifting = sending_full = comparator_output = comparator_next = hung = was_sleeping = false;
    set_due(COMPARATOR, NEVER);
    set_due(CAPTURE, NEVER);
    set_due(SENT, NEVER);
    set_due(SAMPLED, NEVER);
    set_due(CONVERTED, NEVER);
    printf("reset %" PRIu64 " %d\n", avr->cycle, flag);
}

static void reset(uint8_t flag) {
    uint8_t flags = flag & PORF ? 0 : avr->data[MCUSR_];
    avr_reset(avr);
    avr->data[MCUSR_] = flags;
    if (flag & PORF) memset(avr->data + 0x100, 0xA5, avr->ramend - 0xFF);
    begin(flag);
}

static void run_due(void) {
    while (next_due <= avr->cycle) {
        int kind = 0;
        while (due[kind] != next_due) kind++;
        cycles when = next_due;
        switch (kind) {
        case LEVEL:
            millivolts = levels[levels_out++ % QUEUE].millivolts;
            set_due(LEVEL, levels_out == levels_in ? NEVER : levels[levels_out % QUEUE].when);
            compare(when);
            break;
        case RESET: set_due(RESET, NEVER); reset_waits = true; break;  // until this step is over
        case HANG: set_due(HANG, NEVER); hung = true; break;
        case COMPARATOR: set_due(COMPARATOR, NEVER); switch_comparator(when); break;
        case CAPTURE: set_due(CAPTURE, NEVER); capture(when); break;
        case RECEIVED: receive(when); break;
        case SENT: sent(when); break;
        case SAMPLED: hold_sample(when); break;
        case CONVERTED: converted(when); break;
        }
    }
}

static uint8_t pins_before[3];

static void report_pins(void) {
    for (int port = 0; port < 3; port++) {
        uint8_t now = avr->data[PINB_ + 3 * port + 1] & avr->data[PINB_ + 3 * port + 2];
        uint8_t changed = now ^ pins_before[port];
        for (int bit = 0; changed; bit++, changed >>= 1)
            if (changed & 1) printf("pin %" PRIu64 " %c%d %d\n", avr->cycle, 'B' + port, bit, now >> bit & 1);
        pins_before[port] = now;
    }
}

static void step(avr_t *core) {
    avr_flashaddr_t next = core->pc;
    if (hung) core->cycle += 64;
    else if (core->state == cpu_Running) next = avr_run_one(core);
    report_pins();
    run_due();
    uart_levels();
    cycles idle = avr_cycle_timer_process(core);  // may be the watchdog's reset, too
    core->pc = next;
    if (core->run != step || reset_waits) return;
    if (core->state == cpu_Sleeping) {
        was_sleeping = true;
        if (next_due < core->cycle + idle) idle = next_due - core->cycle;
        if (stop_at < core->cycle + idle) idle = stop_at > core->cycle ? stop_at - core->cycle : 0;
        core->cycle += idle;
        run_due();
        uart_levels();
    } else if (core->interrupt_state == 0) {
        was_sleeping = false;
    }
    if (!hung && core->interrupt_state && (core->state == cpu_Running || core->state == cpu_Sleeping))
        avr_service_interrupts(core);
}

static void run_until(cycles end) {
    stop_at = end;
    while (avr->cycle < end) {
        if (avr->run != step) {
            avr->run(avr);  // the watchdog's reset
            begin(WDRF);
        }
        if (reset_waits) reset(reset_flag);
        reset_waits = false;
        step(avr);
        if (avr->state == cpu_Crashed || avr->state == cpu_Done || avr->state == cpu_Stopped) fail("the program crashed");
    }
}

// ---- Set-up and commands ----------------------------------------------------------------------------------------------

static void take(avr_io_addr_t address, avr_io_read_t read, avr_io_write_t write) {
    if (read) avr->io[AVR_DATA_TO_IO(address)].r.c = read;
    if (write) avr->io[AVR_DATA_TO_IO(address)].w.c = write;
}

static void take_over(void) {
    for (avr_io_t *io = avr->io_port; io; io = io->next) {
        if (!strcmp(io->kind, "uart")) uart = (avr_uart_t *)io;
        if (!strcmp(io->kind, "adc")) adc = (avr_adc_t *)io;
        if (!strcmp(io->kind, "timer") && ((avr_timer_t *)io)->name == '1') timer1 = (avr_timer_t *)io;
        if (!strcmp(io->kind, "ac")) {
            avr_int_vector_t *theirs = &((avr_acomp_t *)io)->ac;
            comparator_vector = (avr_int_vector_t){
                .vector = theirs->vector, .enable = theirs->enable, .raised = theirs->raised};
            theirs->vector = 0;  // simavr's own comparator raises nothing
        }
    }
    avr_register_vector(avr, &comparator_vector);
    avr_ioport_getirq_t pin = {.bit = timer1->icp};  // with ACIC the capture does not look at its pin
    if (avr_ioctl(avr, AVR_IOCTL_IOPORT_GETIRQ_REGBIT, &pin) > 0)
        avr_unconnect_irq(pin.irq[0], timer1->io.irq + TIMER_IRQ_IN_ICP);
    timer1->icp.reg = 0;
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = avr->interrupts.vector[i];
        avr_irq_register_notify(vector->irq + AVR_INT_IRQ_RUNNING, on_interrupt, vector);
    }
    of_timer1.read = avr->io[AVR_DATA_TO_IO(TCNT1L_)].r.c, of_timer1.timer = avr->io[AVR_DATA_TO_IO(TCNT1L_)].r.param;
    of_timer1.write_a = avr->io[AVR_DATA_TO_IO(OCR1AL_)].w.c, of_timer1.a = avr->io[AVR_DATA_TO_IO(OCR1AL_)].w.param;
    of_timer1.write_b = avr->io[AVR_DATA_TO_IO(OCR1BL_)].w.c, of_timer1.b = avr->io[AVR_DATA_TO_IO(OCR1BL_)].w.param;
    take(TCNT1L_, read_low, NULL), take(TCNT1H_, read_high, NULL);
    take(ICR1L_, read_low, NULL), take(ICR1H_, read_high, NULL);
    take(OCR1AL_, NULL, write_low), take(OCR1AH_, NULL, write_high);
    take(OCR1BL_, NULL, write_low), take(OCR1BH_, NULL, write_high);
    take(TIFR1_, NULL, write_tifr1);
    take(TIMSK0_, NULL, write_mask), take(TIMSK1_, NULL, write_mask), take(TIMSK2_, NULL, write_mask);
    take(ACSR_, read_acsr, write_acsr);
    take(UDR0_, read_udr, write_udr), take(UCSR0A_, read_plain, write_ucsra), take(UCSR0B_, read_plain, write_plain);
    take(UBRR0L_, NULL, write_plain);
    take(ADCSRA_, NULL, write_adcsra), take(ADCSRB_, NULL, write_plain);
    take(ADCL_, read_plain, NULL), take(ADCH_, read_plain, NULL);
}

static void log_nothing(avr_t *core, const int level, const char *format, va_list list) {
    (void)core;
    if (level <= LOG_ERROR) vfprintf(stderr, format, list);
}

static void start(void) {
    elf_firmware_t program = {0};
    avr_global_logger_set(log_nothing);
    if (elf_read_firmware(elf, &program)) fail("the .elf file cannot be read");
    avr = avr_make_mcu_by_name("atmega328p");
    if (!avr || avr_init(avr)) fail("simavr has no atmega328p");
    program.frequency = 16000000;
    avr_load_firmware(avr, &program);
    avr->run = step;
    avr->run_cycle_limit = 1;
    for (int k = 0; k < KINDS; k++) due[k] = NEVER;
    next_due = NEVER;
    take_over();
    reset(PORF);
}

static void command(char *line) {
    cycles when;
    unsigned a, b;
    int place = 0;
    if (sscanf(line, "run %" SCNu64, &when) == 1) {
        run_until(when);
        printf("at %" PRIu64 "\n", avr->cycle);
    } else if (sscanf(line, "level %" SCNu64 " %u", &when, &a) == 2) {
        if (levels_in - levels_out == QUEUE) fail("too many levels wait");
        levels[levels_in % QUEUE].when = when;
        levels[levels_in++ % QUEUE].millivolts = a;
        if (levels_in - levels_out == 1) set_due(LEVEL, when);
    } else if (sscanf(line, "rx %" SCNu64 " %n", &when, &place) == 1 && place) {
        if (batches_in - batches_out == QUEUE) fail("too much waits on the host's wire");
        uint32_t count = 0;
        for (char *at = line + place; sscanf(at, "%2x", &a) == 1; at += 2, count++) wire[wire_in++ % sizeof wire] = a;
        batches[batches_in % QUEUE].when = when;
        batches[batches_in++ % QUEUE].count = count;
        if (due[RECEIVED] == NEVER) next_from_host();
    } else if (sscanf(line, "reset %" SCNu64 " %u", &when, &a) == 2) {
        reset_flag = a;
        set_due(RESET, when);
    } else if (sscanf(line, "hang %" SCNu64, &when) == 1) {
        set_due(HANG, when);
    } else if (sscanf(line, "bandgap %u", &a) == 1) {
        bandgap_mv = a;
    } else if (sscanf(line, "hostbit %u", &a) == 1) {
        host_bit_1000 = a;
    } else if (sscanf(line, "watch %u", &a) == 1) {
        watched_vectors |= 1u << a;
    } else if (sscanf(line, "peek %x %u", &a, &b) == 2 && a + b <= avr->ramend + 1u) {
        printf("data ");
        while (b--) printf("%02x", avr->data[a++]);
        printf("\n");
    } else if (!strncmp(line, "base", 4)) {
        printf("base %" PRIu64 "\n", timer1->tov_base);
    } else if (sscanf(line, "poke %x %n", &a, &place) == 1 && place) {
        for (char *at = line + place; sscanf(at, "%2x", &b) == 1 && a <= avr->ramend; at += 2) avr->data[a++] = b;
    } else {
        fail("unknown command");
    }
}

int main(int count, char **words) {
    static char line[1 << 16];
    if (count != 2) {
        fprintf(stderr, "usage: %s probe.elf\n", words[0]);
        return 2;
    }
    elf = words[1];
    start();
    while (fgets(line, sizeof line, stdin)) {
        command(line);
        fflush(stdout);
    }
    return 0;
}
