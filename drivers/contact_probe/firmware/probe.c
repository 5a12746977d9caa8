#include "probe.h"

#include <avr/pgmspace.h>
#include <stdbool.h>
#include <string.h>

#include "board.h"
#include "line.h"
#include "loop.h"
#include "outbox.h"

#define PROTOCOL 1
#define VERSION "fw-1.0"

/* Longer ones would keep a wire break from the host for over 5 ms, behind an ID that is being sent. */
_Static_assert(sizeof NAME - 1 <= 24, "NAME has over 24 characters");
_Static_assert(sizeof SERIAL - 1 <= 16, "SERIAL has over 16 characters");

enum state { DISARMED, ARMED, TRIPPED, FAULT };
enum fault { WIRE, STUCK, RANGE, HOST, FAULTS };
enum reply { OK, CLOSED, BROKEN, STATE, UNKNOWN };

static const char kind_names[][6] PROGMEM = {
    [KIND_BOOT] = "BOOT",   [KIND_EDGE] = "EDGE", [KIND_CONF] = "CONF", [KIND_OPEN] = "OPEN", [KIND_FAULT] = "FAULT",
    [KIND_ID] = "ID",       [KIND_SYNC] = "SYNC", [KIND_RE] = "RE",     [KIND_HB] = "HB",
};
static const char state_names[][9] PROGMEM = {"DISARMED", "ARMED", "TRIPPED", "FAULT"};
static const char fault_names[][6] PROGMEM = {"WIRE", "STUCK", "RANGE", "HOST"};
static const char reply_names[][8] PROGMEM = {"OK", "CLOSED", "WIRE", "STATE", "UNKNOWN"};
static const char cause_names[][9] PROGMEM = {"POWER", "EXTERNAL", "BROWNOUT", "WATCHDOG"};
static const char version[] PROGMEM = VERSION;
static const char name[] PROGMEM = NAME;
static const char serial[] PROGMEM = SERIAL;

static enum state state;
static uint8_t faults; /* a bit for each that was reported and not left since */
static enum cause reset_cause;
static tick_t edge; /* of the last contact while armed */
static tick_t host_heard_at;
static bool host_alive;
static tick_t heartbeat_at;
static bool heartbeat_due;

void write_line(const struct message *message, uint16_t seq)
{
    line_begin(kind_names[message->kind], seq);
    switch (message->kind) {
    case KIND_BOOT:
        line_field(PROTOCOL);
        line_text_field(cause_names[reset_cause]);
        break;
    case KIND_ID:
        line_field(message->host_seq);
        line_field(PROTOCOL);
        line_text_field(version);
        line_text_field(name);
        line_text_field(serial);
        line_field(TICK_HZ);
        line_text_field(cause_names[reset_cause]);
        break;
    case KIND_HB:
        line_text_field(state_names[state]);
        line_field(loop_millivolts());
        line_field(host_alive);
        break;
    case KIND_EDGE:
    case KIND_OPEN:
        line_field(message->tick);
        break;
    case KIND_CONF:
        line_field(message->tick);
        line_field(message->confirmed);
        line_field(message->bounces);
        break;
    case KIND_FAULT:
        line_text_field(fault_names[message->code]);
        break;
    case KIND_SYNC:
        line_field(message->host_seq);
        line_field(message->tick);
        break;
    case KIND_RE:
        line_field(message->host_seq);
        line_text_field(reply_names[message->code]);
        break;
    }
    line_end();
}

static void post_event(enum kind kind, tick_t tick)
{
    outbox_post(&(struct message){.kind = kind, .tick = tick});
}

static void reply(uint16_t host_seq, enum reply code)
{
    outbox_post(&(struct message){.kind = KIND_RE, .host_seq = host_seq, .code = code});
}

static void report_fault(enum fault fault)
{
    state = FAULT;
    loop_disarm();
    if (faults & _BV(fault))
        return;
    faults |= _BV(fault);
    outbox_post(&(struct message){.kind = KIND_FAULT, .code = fault});
}

/* Faults whose cause is there now: DISARM does not leave them. */
static uint8_t standing_faults(void)
{
    switch (loop_level()) {
    case LEVEL_BROKEN:
        return _BV(WIRE);
    case LEVEL_UNDEFINED:
        return _BV(RANGE);
    case LEVEL_CLOSED:
        return _BV(STUCK);
    default:
        return 0;
    }
}

static enum reply arm(void)
{
    if (loop_level() == LEVEL_BROKEN)
        return BROKEN; /* in any state: this is what somebody can mend */
    if (state != DISARMED && state != ARMED)
        return STATE;
    if (!loop_arm())
        return CLOSED;
    state = ARMED;
    return OK;
}

static enum reply disarm(void)
{
    faults &= standing_faults();
    if (faults & _BV(WIRE))
        return BROKEN;
    if (faults & _BV(STUCK))
        return CLOSED;
    if (faults)
        return STATE;
    loop_disarm();
    state = DISARMED;
    return OK;
}

/* The answers to the last ARM and DISARM: a repeated one is answered again, not executed again. */
static struct answer {
    uint16_t seq;
    uint8_t command; /* COMMAND_UNKNOWN: none */
    uint8_t reply;
} answers[8];
static uint8_t next_answer;

static void forget_answers(void)
{
    for (uint8_t k = 0; k < sizeof answers / sizeof *answers; k++)
        answers[k].command = COMMAND_UNKNOWN;
}

static enum reply execute_once(const struct host_line *line)
{
    for (uint8_t k = 0; k < sizeof answers / sizeof *answers; k++)
        if (answers[k].command == line->command && answers[k].seq == line->seq)
            return answers[k].reply;
    struct answer *answer = &answers[next_answer++ % (sizeof answers / sizeof *answers)];
    answer->seq = line->seq;
    answer->command = line->command;
    answer->reply = line->command == COMMAND_ARM ? arm() : disarm();
    return answer->reply;
}

static void hear(const struct host_line *line, tick_t now)
{
    host_heard_at = now;
    host_alive = true;
    switch (line->command) {
    case COMMAND_ACK:
        outbox_acknowledge(line->seq);
        break;
    case COMMAND_HELLO:
        forget_answers(); /* it may come from a new host, whose numbers begin anew */
        outbox_post(&(struct message){.kind = KIND_ID, .host_seq = line->seq});
        break;
    case COMMAND_ARM:
    case COMMAND_DISARM:
        reply(line->seq, execute_once(line));
        break;
    case COMMAND_SYNC:
        outbox_post(&(struct message){.kind = KIND_SYNC, .host_seq = line->seq, .tick = line->received});
        break;
    case COMMAND_UNKNOWN:
        reply(line->seq, UNKNOWN);
        break;
    }
}

static void report_contact(void)
{
    struct confirmation found;
    tick_t opening;
    if (loop_take_edge(&edge)) {
        if (state == ARMED)
            state = TRIPPED;
        post_event(KIND_EDGE, edge);
    }
    if (loop_take_confirmation(&found))
        outbox_post(&(struct message){
            .kind = KIND_CONF, .tick = edge, .confirmed = found.held, .bounces = found.bounces});
    if (loop_take_opening(&opening))
        post_event(KIND_OPEN, opening);
}

static void watch_for_faults(tick_t now)
{
    if (loop_level() == LEVEL_BROKEN)
        report_fault(WIRE);
    if (loop_level() == LEVEL_UNDEFINED)
        report_fault(RANGE);
    if (loop_is_stuck())
        report_fault(STUCK);
    if (host_alive && clock_reached(now, host_heard_at + MS(HOST_SILENT_MS)))
        host_alive = false;
    if (state == ARMED && !host_alive)
        report_fault(HOST);
}

void probe_start(enum cause cause)
{
    reset_cause = cause;
    forget_answers();
    heartbeat_at = clock_now() + MS(HEARTBEAT_MS);
    post_event(KIND_BOOT, 0);
}

void probe_update(void)
{
    tick_t now = clock_now();
    struct host_line line;
    loop_update(now);
    report_contact();
    watch_for_faults(now);
    if (line_receive(&line))
        hear(&line, now);
    loop_drive_output(host_alive);
    if (clock_reached(now, heartbeat_at)) {
        heartbeat_at += MS(HEARTBEAT_MS);
        heartbeat_due = true;
    }
    if (outbox_send(heartbeat_due, now))
        heartbeat_due = false;
}
