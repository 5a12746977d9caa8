/* The loop of tip and sphere: comparator with hardware capture, A/D converter, stop output. */
#ifndef LOOP_H
#define LOOP_H

#include <stdbool.h>
#include <stdint.h>

#include "clock.h"

enum level {
    LEVEL_UNKNOWN, /* less than four samples since the start */
    LEVEL_CLOSED,
    LEVEL_OPEN,
    LEVEL_BROKEN,
    LEVEL_UNDEFINED, /* none of these: a bad joint, moisture, a foreign voltage */
};

struct confirmation {
    bool held; /* the loop was closed 2 ms after the first edge */
    uint8_t bounces;
};

void loop_start(void);

/* Follow comparator and A/D converter: once in each pass of the main loop, which began at `now`. */
void loop_update(tick_t now);

/* Whether an interrupt has left something for `loop_update`. Interrupts are disabled. */
bool loop_has_news(void);

/* Number of A/D samples, modulo 256. */
uint8_t loop_samples(void);

enum level loop_level(void);
uint16_t loop_millivolts(void);

/* Closed for over 10 s. */
bool loop_is_stuck(void);

/* Watch for the first edge to closed. False, and not armed: the loop is not open, or not open for 20 ms yet. */
bool loop_arm(void);
void loop_disarm(void);

/* Each is true once: the first edge while armed; its confirmation; open for 20 ms after a contact (the opening edge). */
bool loop_take_edge(tick_t *edge);
bool loop_take_confirmation(struct confirmation *found);
bool loop_take_opening(tick_t *edge);

/* Switch the stop output on if the loop permits it, too, else off. */
void loop_drive_output(bool host_alive);

#endif
