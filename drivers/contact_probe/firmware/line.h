/* Lines of the protocol, docs/reference/probe-protocol.md: check sum, writing, reading. */
#ifndef LINE_H
#define LINE_H

#include <avr/pgmspace.h>
#include <stdbool.h>
#include <stdint.h>

#include "clock.h"

#define LINE_LONGEST 120 /* without the \n */

/* Write a line: begin, fields, end. Its first character leaves at once, and gives the line its tick; the further ones
 * are written while it is sent. Texts are in flash. */
void line_begin(PGM_P kind, uint16_t seq);
void line_field(uint32_t number);
void line_text_field(PGM_P text);
void line_end(void);

enum command { COMMAND_ACK, COMMAND_HELLO, COMMAND_ARM, COMMAND_DISARM, COMMAND_SYNC, COMMAND_UNKNOWN };

struct host_line {
    enum command command;
    uint16_t seq;
    tick_t received; /* the reception of its \n */
};

/* The host's next complete and valid line, if there is one. Invalid ones are dropped and counted. */
bool line_receive(struct host_line *line);

#endif
