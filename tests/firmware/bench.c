// SPDX-License-Identifier: GPL-3.0-or-later
// (simavr, which this links, has that licence. It is a tool of the tests: nothing that cellctl ships links it.)
//
// The probe's firmware in a simulated ATmega328P at 16 MHz, stepped over stdin and stdout. `bench probe.elf`; one
// command a line; README.md has the list. simavr runs the core, the ports, timers, watchdog and EEPROM. Its UART, A/D
// converter, comparator and input capture differ from the chip (README.md says how); the other files model them.
#include "chip.h"

enum { ENTRY_CYCLES = 4, WAKE_CYCLES = 4 };  // of an interrupt, and of idle sleep before it (7.7.1)

avr_t *avr;
cycles due[KINDS];
static cycles next_due, stop_at;
static uint32_t watched_vectors;
static bool hung, was_sleeping;

void set_due(enum due_kind kind, cycles when) {
    due[kind] = when;
    next_due = NEVER;
    for (int k = 0; k < KINDS; k++)
        if (due[k] < next_due) next_due = due[k];
}

void fail(const char *text) {
    printf("error %s\n", text);
    fflush(stdout);
    exit(1);
}

// Interrupts

void raise_if(avr_int_vector_t *vector, bool condition) {
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

// Reset, and one step

static uint8_t reset_flag;
static bool reset_waits;

static void begin(uint8_t flag) {
    avr->data[MCUSR_] |= flag;
    hung = was_sleeping = false;
    comparator_reset();
    uart_reset();
    converter_reset();
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
        case LEVEL: next_level(when); break;
        case RESET: set_due(RESET, NEVER); reset_waits = true; break;  // until this step is over
        case HANG: set_due(HANG, NEVER); hung = true; break;
        case COMPARATOR: set_due(COMPARATOR, NEVER); switch_comparator(when); break;
        case CAPTURE: set_due(CAPTURE, NEVER); capture(when); break;
        case RECEIVED: receive(when); break;
        case SENT: sent(when); break;
        case SAMPLED: hold_sample(); break;
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

// Set-up and commands

void take(avr_io_addr_t address, avr_io_read_t read, avr_io_write_t write) {
    if (read) avr->io[AVR_DATA_TO_IO(address)].r.c = read;
    if (write) avr->io[AVR_DATA_TO_IO(address)].w.c = write;
}

uint8_t read_plain(avr_t *core, avr_io_addr_t address, void *unused) {
    (void)unused;
    return core->data[address];
}

void write_plain(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    core->data[address] = value;
}

void *module_of(const char *kind, char name) {
    for (avr_io_t *io = avr->io_port; io; io = io->next)
        if (!strcmp(io->kind, kind) && (!name || ((avr_timer_t *)io)->name == name)) return io;
    fail("simavr's chip lacks a part");
    return NULL;
}

static void take_over(void) {
    comparator_take_over();
    uart_take_over();
    converter_take_over();
    take(TIMSK0_, NULL, write_mask), take(TIMSK1_, NULL, write_mask), take(TIMSK2_, NULL, write_mask);
    for (int i = 0; i < avr->interrupts.vector_count; i++) {
        avr_int_vector_t *vector = avr->interrupts.vector[i];
        avr_irq_register_notify(vector->irq + AVR_INT_IRQ_RUNNING, on_interrupt, vector);
    }
}

static void log_nothing(avr_t *core, const int level, const char *format, va_list list) {
    (void)core;
    if (level <= LOG_ERROR) vfprintf(stderr, format, list);
}

static void start(const char *elf) {
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
        add_level(when, a);
    } else if (sscanf(line, "rx %" SCNu64 " %n", &when, &place) == 1 && place) {
        put_on_wire(when, line + place);
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
    start(words[1]);
    while (fgets(line, sizeof line, stdin)) {
        command(line);
        fflush(stdout);
    }
    return 0;
}
