#include "outbox.h"

#include "board.h"
#include "uart.h"

#define ROOM 16

static struct entry {
    struct message message;
    uint16_t seq;     /* given when it is first sent */
    tick_t repeat_at; /* after it was first sent */
    enum { FREE, NEW, SENT } state;
} entries[ROOM]; /* in the order of posting, the free ones last */

static uint16_t next_seq;

static bool is_answer(const struct entry *entry)
{
    return entry->message.kind >= KIND_ID;
}

static void discard(struct entry *entry)
{
    for (; entry < entries + ROOM - 1; entry++)
        *entry = entry[1];
    entry->state = FREE;
}

static struct entry *oldest_answer(void)
{
    for (struct entry *entry = entries; entry < entries + ROOM; entry++)
        if (is_answer(entry))
            return entry;
    return entries;
}

void outbox_post(const struct message *message)
{
    struct entry *last = entries + ROOM - 1;
    if (last->state != FREE)
        discard(oldest_answer());
    while (last > entries && last[-1].state == FREE)
        last--;
    last->message = *message;
    last->state = NEW;
}

void outbox_acknowledge(uint16_t seq)
{
    for (struct entry *entry = entries; entry < entries + ROOM; entry++)
        if (entry->state == SENT && entry->seq == seq) {
            discard(entry);
            return;
        }
}

static struct entry *next_new(void)
{
    struct entry *answer = 0;
    for (struct entry *entry = entries; entry < entries + ROOM && entry->state != FREE; entry++) {
        if (entry->state != NEW)
            continue;
        if (!is_answer(entry))
            return entry;
        if (!answer)
            answer = entry;
    }
    return answer;
}

static struct entry *next_repetition(tick_t now)
{
    struct entry *longest_due = 0;
    for (struct entry *entry = entries; entry < entries + ROOM && entry->state != FREE; entry++)
        if (entry->state == SENT && clock_reached(now, entry->repeat_at) &&
            (!longest_due || clock_reached(longest_due->repeat_at, entry->repeat_at)))
            longest_due = entry;
    return longest_due;
}

bool outbox_send(bool heartbeat_due)
{
    if (!uart_is_idle())
        return false;
    tick_t now = clock_now();
    struct entry *entry = next_new();
    if (!entry && heartbeat_due) {
        static const struct message heartbeat = {.kind = KIND_HB};
        write_line(&heartbeat, next_seq++);
        return true;
    }
    if (!entry)
        entry = next_repetition(now);
    if (!entry)
        return false;
    if (entry->state == NEW) {
        entry->state = SENT;
        entry->seq = next_seq++;
    }
    entry->repeat_at = now + MS(REPEAT_MS);
    write_line(&entry->message, entry->seq);
    return false;
}
