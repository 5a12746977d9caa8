// A program that shows whether the bench behaves as the chip: it reports resets, echoes bytes, and reports captures.

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

static uint8_t cause __attribute__((section(".noinit")));

static void early(void) __attribute__((naked, used, section(".init3")));
static void early(void) {
    cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

static void put(uint8_t byte) {
    while (!(UCSR0A & 1 << UDRE0)) {}
    UDR0 = byte;
}

ISR(TIMER1_CAPT_vect) {
    uint16_t count = ICR1;
    PORTB ^= 1 << PB0;
    put('C');
    put(count >> 8);
    put(count);
}

static uint16_t convert(uint8_t channel) {
    ADMUX = 1 << REFS0 | channel;
    ADCSRA |= 1 << ADSC;
    while (ADCSRA & 1 << ADSC) {}
    return ADC;
}

int main(void) {
    DDRB = 1 << PB0;
    UBRR0 = 3;
    UCSR0B = 1 << RXEN0 | 1 << TXEN0;
    TCCR1B = 1 << ICNC1 | 1 << ICES1 | 1 << CS11;
    ACSR = 1 << ACBG | 1 << ACIC;
    ADCSRA = 1 << ADEN | 7;
    TIMSK1 = 1 << ICIE1;
    sei();
    put('R');
    put(cause);
    for (;;) {
        if (!(UCSR0A & 1 << RXC0)) continue;
        uint8_t overrun = UCSR0A & 1 << DOR0, byte = UDR0;
        if (overrun) put('!');
        put(byte);
        if (byte == 'a') {
            uint16_t volts = convert(0);
            put(volts >> 8);
            put(volts);
        } else if (byte == 'w') {
            wdt_enable(WDTO_30MS);
            cli();
            for (;;) {}
        } else if (byte == 'o') {  // deaf for 15 bytes
            for (uint16_t i = 0; i < 2000; i++) __asm__ volatile("nop");
        } else if (byte == 's') {  // of an edge meanwhile, the flag stays until its interrupt is enabled again
            cli();
            TIMSK1 = 0;
            for (uint16_t i = 0; i < 2000; i++) __asm__ volatile("nop");
            TIFR1 = 1 << TOV1;
            put(TIFR1);
            TIMSK1 = 1 << ICIE1;
            sei();
        }
    }
}
