// SPDX-License-Identifier: GPL-3.0-or-later
// What the parts of the simulated chip share. Sections named in comments are those of the data sheet, DS40002061B.
#ifndef CHIP_H
#define CHIP_H

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

extern avr_t *avr;

// What is due, one entry for each kind, done in the order of their times.
enum due_kind { LEVEL, RESET, HANG, COMPARATOR, CAPTURE, RECEIVED, SENT, SAMPLED, CONVERTED, KINDS };
extern cycles due[KINDS];
void set_due(enum due_kind kind, cycles when);

// End with `error TEXT`.
void fail(const char *text);

// simavr's module of this kind; `name`: of several, else 0.
void *module_of(const char *kind, char name);

// A level that asks for its interrupt, or no longer does. (simavr knows events only.)
void raise_if(avr_int_vector_t *vector, bool condition);

// Functions for a register's reads and writes in place of simavr's; NULL: leave it.
void take(avr_io_addr_t address, avr_io_read_t read, avr_io_write_t write);
uint8_t read_plain(avr_t *core, avr_io_addr_t address, void *unused);
void write_plain(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused);

// comparator.c: the loop's voltage, the comparator, the capture, the registers of Timer1
extern uint16_t millivolts, bandgap_mv;
extern avr_timer_t *timer1;
void comparator_take_over(void);
void comparator_reset(void);
void add_level(cycles when, uint16_t level_mv);
void next_level(cycles when);
void switch_comparator(cycles when);
void capture(cycles when);

// uart.c
extern cycles host_bit_1000;
void uart_take_over(void);
void uart_reset(void);
void uart_levels(void);
void put_on_wire(cycles when, const char *hex);
void receive(cycles when);
void sent(cycles when);

// converter.c
void converter_take_over(void);
void converter_reset(void);
void hold_sample(void);
void converted(cycles when);

#endif
