#include "uart.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

/* Rings of 256 characters: an index wraps by itself. That of reception holds 10 ms; if it overflows all the same, the
 * check sum of what is left in it is wrong. */
static char received[256];
static volatile uint8_t received_head, received_tail;
static volatile uint8_t newline_head; /* where the last \n is */
static volatile uint16_t newline_cycles;

static char to_send[256];
static volatile uint8_t send_head, send_tail;
static bool begun;

ISR(USART_RX_vect)
{
    uint8_t errors = UCSR0A & (_BV(FE0) | _BV(DOR0)); /* before UDR0, which takes them along */
    char character = UDR0;
    uint8_t head = received_head;
    if (errors)
        character = 0;
    received[head] = character;
    if (character == '\n') {
        newline_cycles = TCNT1;
        newline_head = head;
    }
    received_head = head + 1;
}

ISR(USART_UDRE_vect)
{
    uint8_t tail = send_tail;
    UDR0 = to_send[tail++];
    UCSR0A = _BV(TXC0); /* cleared by writing 1: set again when this character has left and none follows */
    send_tail = tail;
    if (tail == send_head)
        UCSR0B &= ~_BV(UDRIE0);
}

void uart_start(void)
{
    UBRR0 = F_CPU / 16 / BAUD - 1; /* exact: 64 cycles a bit */
    UCSR0A = 0;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
}

bool uart_has_received(void)
{
    return received_head != received_tail;
}

bool uart_read(char *character)
{
    uint8_t tail = received_tail;
    if (tail == received_head)
        return false;
    *character = received[tail];
    received_tail = tail + 1;
    return true;
}

tick_t uart_newline_tick(void)
{
    struct instant at;
    uint16_t cycles;
    uint8_t head;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        cycles = newline_cycles;
        head = newline_head;
        at = clock_instant(TCNT1);
    }
    bool latest = head == (uint8_t)(received_tail - 1);
    return clock_tick(at, latest ? at.cycles - cycles : 0);
}

bool uart_is_idle(void)
{
    return !begun || (send_head == send_tail && (UCSR0A & _BV(TXC0)));
}

tick_t uart_begin(char first)
{
    struct instant at;
    begun = true;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        UDR0 = first;
        UCSR0A = _BV(TXC0);
        at = clock_instant(TCNT1);
    }
    return clock_tick(at, 0);
}

void uart_send(char character)
{
    uint8_t head = send_head;
    to_send[head] = character;
    send_head = head + 1;
    UCSR0B |= _BV(UDRIE0); /* not atomic: all that an interrupt can change meanwhile is this bit */
}
