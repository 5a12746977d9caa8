/* The probe's lines: numbered, sent one after the other, repeated until the host acknowledges them. */
#ifndef OUTBOX_H
#define OUTBOX_H

#include <stdbool.h>
#include <stdint.h>

#include "clock.h"

enum kind {
    /* events */
    KIND_BOOT,
    KIND_EDGE,
    KIND_CONF,
    KIND_OPEN,
    KIND_FAULT,
    /* answers */
    KIND_ID,
    KIND_SYNC,
    KIND_RE,
    KIND_HB, /* never repeated, so not in the outbox */
};

struct message {
    enum kind kind;
    uint8_t code;      /* FAULT, RE: see probe.c */
    uint8_t confirmed; /* CONF */
    uint8_t bounces;   /* CONF */
    uint16_t host_seq; /* answers: of the command */
    tick_t tick;       /* EDGE, CONF, OPEN: of the edge; SYNC: of its reception */
};

/* A full outbox gives up its oldest answer, else its oldest event. */
void outbox_post(const struct message *message);

/* The host has the line of this number. */
void outbox_acknowledge(uint16_t seq);

/* If the line is free, send what comes next: a new event, a new answer, a heartbeat if `heartbeat_due`, a repetition.
 * Returns whether it was the heartbeat. */
bool outbox_send(bool heartbeat_due, tick_t now);

/* Write a line of a message (for a heartbeat: of the present state). In probe.c, which knows their meaning. */
void write_line(const struct message *message, uint16_t seq);

#endif
