#include "loop.h"

#include <avr/interrupt.h>
#include <util/atomic.h>

/* The comparator compares the loop on AIN1 with the bandgap: its output is 1 while the loop is below 1.1 V, that is,
 * closed. The output is routed to Timer1's capture input; each captured edge turns the direction of the next one, so
 * that bounces are counted both ways. The direction is also the memory of the comparator's last level. */
#define WATCHING_FOR_CLOSED _BV(ICES1)

static volatile uint8_t edges, edges_seen; /* modulo 256; by the main loop */
static volatile struct instant last_edge;
static volatile bool armed;
static volatile struct instant first_edge; /* of a contact while armed */
static volatile bool edge_found;
static volatile bool counting; /* from the first edge until 2 ms later */
static volatile uint8_t bounces;
static volatile bool held;
static volatile bool confirmation_found;

static volatile uint16_t sample;
static volatile uint8_t samples;
static volatile uint8_t edges_before_sample; /* the sample is newer than these edges */

static inline __attribute__((always_inline)) bool comparator_closed(void)
{
    return !(TCCR1B & WATCHING_FOR_CLOSED);
}

static inline __attribute__((always_inline)) bool capture_pending(void)
{
    return TIFR1 & _BV(ICF1);
}

static inline __attribute__((always_inline)) void take_edge(struct instant at)
{
    bool closing = !comparator_closed();
    TCCR1B ^= WATCHING_FOR_CLOSED;
    TIFR1 = _BV(ICF1); /* turning the direction may have set it */
    last_edge.overflows = at.overflows; /* member by member: a copy of the whole goes over the stack */
    last_edge.cycles = at.cycles;
    edges++;
    if (counting) {
        uint8_t count = bounces;
        if (count < UINT8_MAX)
            bounces = count + 1;
    } else if (closing && armed) {
        armed = false;
        first_edge.overflows = at.overflows;
        first_edge.cycles = at.cycles;
        edge_found = true;
        bounces = 0;
        counting = true;
        OCR1A = at.cycles - CAPTURE_DELAY_CYCLES + (uint16_t)(MS(CONFIRM_MS) * CYCLES_PER_TICK);
        TIFR1 = _BV(OCF1A);
        TIMSK1 |= _BV(OCIE1A);
    }
}

/* An edge: the first instruction drops the stop output, before any register is saved. At an opening edge it is off
 * already. `cbi` changes no register and no flag. */
ISR(TIMER1_CAPT_vect, ISR_NAKED)
{
    __asm__ volatile("cbi %0, %1\n\trjmp __vector_captured" ::"I"(_SFR_IO_ADDR(OK_PORT)), "I"(OK_BIT));
}

void __vector_captured(void) __attribute__((signal, used));
void __vector_captured(void)
{
    take_edge(clock_instant(ICR1));
    if ((uint8_t)(edges - edges_seen) >= MOST_EDGES)
        TIMSK1 &= ~_BV(ICIE1); /* until the main loop has seen them; the stop output is off for 20 ms */
}

/* 2 ms after the first edge. */
ISR(TIMER1_COMPA_vect)
{
    TIMSK1 &= ~_BV(OCIE1A);
    counting = false;
    held = comparator_closed();
    confirmation_found = true;
}

ISR(ADC_vect)
{
    static uint8_t edges_at_start;
    sample = ADC;
    samples++;
    edges_before_sample = edges_at_start;
    edges_at_start = edges; /* the next conversion has begun, and samples the loop 12 µs after its start */
}

static enum level level = LEVEL_UNKNOWN;
static tick_t level_since;
static bool level_lasts; /* for 20 ms if open, for 10 s if closed */
static bool touched;     /* closed, and not open for 20 ms since */
static bool opened;
static uint16_t millivolts;
static uint8_t samples_seen;

void loop_start(void)
{
    OK_DDR |= _BV(OK_BIT);
    LED_DDR |= _BV(LED_BIT);
    DIDR1 = _BV(AIN1D);
    DIDR0 = _BV(ADC0D);
    ACSR = _BV(ACBG) | _BV(ACIC);
    TCCR1B |= _BV(ICNC1) | WATCHING_FOR_CLOSED; /* if the loop is closed, the first pass of the main loop finds it */
    TIFR1 = _BV(ICF1);
    TIMSK1 |= _BV(ICIE1);
    ADMUX = _BV(REFS0); /* the supply, which feeds the loop, too */
    ADCSRB = 0;
    /* Free running, 125 kHz: 13 clocks, 104 µs a sample. */
    ADCSRA = _BV(ADEN) | _BV(ADSC) | _BV(ADATE) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0);
}

static enum level level_of(uint16_t mv)
{
    if (mv < CLOSED_BELOW_MV)
        return LEVEL_CLOSED;
    if (mv >= OPEN_FROM_MV && mv <= OPEN_TO_MV)
        return LEVEL_OPEN;
    return mv > BROKEN_ABOVE_MV ? LEVEL_BROKEN : LEVEL_UNDEFINED;
}

static void change_level(enum level to, tick_t since)
{
    level = to;
    level_since = since;
    level_lasts = false;
    if (to == LEVEL_CLOSED) {
        touched = true;
        LED_PORT |= _BV(LED_BIT);
    } else {
        LED_PORT &= ~_BV(LED_BIT);
    }
}

/* A level that the A/D converter alone can see, or sees without an edge of the comparator, counts once it is steady.
 * The sample that is older than the comparator's last edge says nothing. If the comparator chatters, each is: then those
 * count that are neither closed nor open, which are the comparator's. */
static void judge_sample(bool newer_than_edges, tick_t now)
{
    static enum level candidate;
    static uint8_t run;
    static bool older_before; /* the sample before was older than an edge, too */
    enum level seen = level_of(millivolts);
    if (!newer_than_edges && (!older_before || seen == LEVEL_CLOSED || seen == LEVEL_OPEN)) {
        older_before = true;
        run = 0;
        return;
    }
    older_before = !newer_than_edges;
    run = run == 0 || seen != candidate ? 1 : run + 1;
    candidate = seen;
    if (run < STEADY_SAMPLES)
        return;
    run = STEADY_SAMPLES;
    if (seen != level)
        change_level(seen, now);
}

/* An edge between a capture and the turning of its direction is lost: a bounce of a few microseconds. The first edge
 * of a contact cannot be: the direction has been right for 20 ms then. */
static void find_lost_edge(void)
{
    bool closed = ACSR & _BV(ACO);
    if (closed == comparator_closed())
        return;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        closed = ACSR & _BV(ACO);
        __builtin_avr_delay_cycles(CAPTURE_DELAY_CYCLES); /* an edge on its way to its capture arrives meanwhile */
        if (closed != comparator_closed() && !capture_pending())
            take_edge(clock_instant(TCNT1));
    }
}

static void follow_comparator(void)
{
    bool closed, news;
    struct instant at;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        uint8_t edges_now = edges;
        closed = comparator_closed();
        at.overflows = last_edge.overflows;
        at.cycles = last_edge.cycles;
        news = edges_now != edges_seen;
        edges_seen = edges_now;
        TIMSK1 |= _BV(ICIE1);
    }
    if (!news)
        return;
    touched = true; /* even if it is open again: then it was closed in between */
    change_level(closed ? LEVEL_CLOSED : LEVEL_OPEN, clock_tick(at, CAPTURE_DELAY_CYCLES));
}

static void follow_converter(tick_t now)
{
    uint8_t samples_now, edges_before;
    uint16_t raw;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        samples_now = samples;
        edges_before = edges_before_sample;
        raw = sample;
    }
    if (samples_now == samples_seen)
        return;
    samples_seen = samples_now;
    millivolts = raw * (SUPPLY_MV / 4) / 256; /* of 1024 steps */
    judge_sample(edges_before == edges_seen, now);
}

void loop_update(tick_t now)
{
    find_lost_edge();
    follow_comparator();
    follow_converter(now);
    tick_t limit = level == LEVEL_CLOSED ? MS(STUCK_MS) : MS(OPEN_MS);
    if (level_lasts || !clock_reached(now, level_since + limit))
        return;
    level_lasts = true;
    if (level == LEVEL_OPEN && touched) {
        touched = false;
        opened = true;
    }
}

bool loop_has_news(void)
{
    return edges != edges_seen || samples != samples_seen || confirmation_found;
}

uint8_t loop_samples(void)
{
    return samples;
}

enum level loop_level(void)
{
    return level;
}

uint16_t loop_millivolts(void)
{
    return millivolts;
}

bool loop_is_stuck(void)
{
    return level == LEVEL_CLOSED && level_lasts;
}

/* Open for 20 ms, and no edge that waits to be handled. Interrupts are disabled. */
static bool verified_open(void)
{
    return level == LEVEL_OPEN && level_lasts && edges == edges_seen && !comparator_closed() && !capture_pending();
}

bool loop_arm(void)
{
    bool open;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        open = verified_open();
        armed = open;
    }
    return open;
}

void loop_disarm(void)
{
    armed = false;
}

bool loop_take_edge(tick_t *edge)
{
    if (!edge_found)
        return false;
    edge_found = false;
    /* No longer armed, so that no interrupt writes it. */
    *edge = clock_tick((struct instant){first_edge.overflows, first_edge.cycles}, CAPTURE_DELAY_CYCLES);
    return true;
}

bool loop_take_confirmation(struct confirmation *found)
{
    if (!confirmation_found)
        return false;
    confirmation_found = false;
    /* The comparator takes everything below 1.1 V for closed. */
    found->held = held && level != LEVEL_UNDEFINED;
    found->bounces = bounces;
    return true;
}

bool loop_take_opening(tick_t *edge)
{
    if (!opened)
        return false;
    opened = false;
    *edge = level_since;
    return true;
}

void loop_drive_output(bool host_alive)
{
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE)
    {
        if (host_alive && verified_open())
            OK_PORT |= _BV(OK_BIT);
        else
            OK_PORT &= ~_BV(OK_BIT);
    }
}
