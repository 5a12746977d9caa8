/* The probe's states and what it says of them. */
#ifndef PROBE_H
#define PROBE_H

#include <stdint.h>

enum cause { CAUSE_POWER, CAUSE_EXTERNAL, CAUSE_BROWNOUT, CAUSE_WATCHDOG };

void probe_start(enum cause cause);

/* Once in each pass of the main loop. */
void probe_update(void);

#endif
