// SPDX-License-Identifier: GPL-3.0-or-later
// The UART (20): ten bits a byte, two bytes of buffer each way, and the shift registers.
#include "chip.h"

static avr_uart_t *uart;
static uint16_t received[3];  // with FRAMING for a byte whose stop bit was not one
#define FRAMING 0x100
static uint8_t received_count;  // the third waits in the shift register
static bool overrun, shifting, sending_full;
static uint8_t sending_next;
static uint8_t wire[1 << 20];  // from the host, on its way
static uint32_t wire_in, wire_out;
static struct { cycles when; uint32_t count; } batches[QUEUE];
static unsigned batches_in, batches_out;
cycles host_bit_1000 = 64000;  // a bit of the host, in thousandths of a cycle
static cycles wire_free_1000;

static cycles bit_cycles(void) {
    uint32_t ubrr = avr->data[UBRR0L_] | (avr->data[UBRR0H_] & 0xF) << 8;
    return (ubrr + 1) * (avr->data[UCSR0A_] & U2X ? 8 : 16);
}

void uart_levels(void) {
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

void receive(cycles when) {
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

void sent(cycles when) {
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

static void write_ucsrb(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    core->data[address] = value;
    if (value & RXEN) return;
    received_count = 0;
    set_flag(RXC, false);
}

void put_on_wire(cycles when, const char *hex) {
    if (batches_in - batches_out == QUEUE) fail("too much waits on the host's wire");
    uint32_t count = 0;
    unsigned byte;
    for (; sscanf(hex, "%2x", &byte) == 1; hex += 2, count++) {
        if (wire_in - wire_out == sizeof wire) fail("too much waits on the host's wire");
        wire[wire_in++ % sizeof wire] = byte;
    }
    batches[batches_in % QUEUE].when = when;
    batches[batches_in++ % QUEUE].count = count;
    if (due[RECEIVED] == NEVER) next_from_host();
}

void uart_reset(void) {
    avr->data[UCSR0A_] = UDRE;
    avr->data[UCSR0B_] = 0;
    received_count = 0;
    overrun = shifting = sending_full = false;
    set_due(SENT, NEVER);
}

void uart_take_over(void) {
    uart = module_of("uart", 0);
    take(UDR0_, read_udr, write_udr), take(UCSR0A_, read_plain, write_ucsra), take(UCSR0B_, read_plain, write_ucsrb);
    take(UBRR0L_, NULL, write_plain);
}
