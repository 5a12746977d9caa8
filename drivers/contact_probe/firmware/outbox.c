#include "outbox.h"

#include <string.h>

#include "board.h"
#include "uart.h"

#define ROOM 16

static struct entry {
    struct message message;
    bool sent;
    uint16_t seq;     /* given when it is first sent */
    tick_t repeat_at; /* after that */
} entries[ROOM], *end = entries; /* in the order of posting */

static uint16_t next_seq;

static bool is_answer(const struct entry *entry)
{
    return entry->message.kind >= KIND_ID;
}

static void discard(struct entry *entry)
{
    end--;
    memmove(entry, entry + 1, (uint8_t *)end - (uint8_t *)entry);
}

static struct entry *oldest_answer(void)
{
    for (struct entry *entry = entries; entry < end; entry++)
        if (is_answer(entry))
            return entry;
    return entries;
}

void outbox_post(const struct message *message)
{
    if (end == entries + ROOM)
        discard(oldest_answer());
    end->message = *message;
    end->sent = false;
    end++;
}

void outbox_acknowledge(uint16_t seq)
{
    for (struct entry *entry = entries; entry < end; entry++)
        if (entry->sent && entry->seq == seq) {
            discard(entry);
            return;
        }
}

static struct entry *next_new(void)
{
    struct entry *answer = 0;
    for (struct entry *entry = entries; entry < end; entry++) {
        if (entry->sent)
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
    for (struct entry *entry = entries; entry < end; entry++)
        if (entry->sent && clock_reached(now, entry->repeat_at) &&
            (!longest_due || clock_reached(longest_due->repeat_at, entry->repeat_at)))
            longest_due = entry;
    return longest_due;
}

bool outbox_send(bool heartbeat_due, tick_t now)
{
    if (!uart_is_idle())
        return false;
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
    if (!entry->sent) {
        entry->sent = true;
        entry->seq = next_seq++;
    }
    entry->repeat_at = now + MS(REPEAT_MS);
    write_line(&entry->message, entry->seq);
    return false;
}
