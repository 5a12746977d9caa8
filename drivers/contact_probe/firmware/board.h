/* The board: pins, times and thresholds. Circuit: schematic.svg; levels: docs/reference/probe-protocol.md. */
#ifndef BOARD_H
#define BOARD_H

#include <avr/io.h>

/* Loop node: AIN1 (PD7, "D7") for the comparator and ADC0 (PC0, "A0") for the A/D converter. */

#define OK_PORT PORTD /* stop output: high while the loop is intact and open and the host is alive */
#define OK_DDR DDRD
#define OK_BIT PD4 /* "D4" */

#define LED_PORT PORTB /* on while the loop is closed */
#define LED_DDR DDRB
#define LED_BIT PB5 /* "D13" */

#define BAUD 250000UL
#define TICK_HZ 2000000UL
#define CYCLES_PER_TICK (F_CPU / TICK_HZ)
#define MS(milliseconds) ((uint32_t)(milliseconds) * (TICK_HZ / 1000))

#define CONFIRM_MS 2
#define OPEN_MS 20
#define STUCK_MS 10000
#define HOST_SILENT_MS 500
#define HEARTBEAT_MS 50
#define REPEAT_MS 50

/* Loop voltage in mV. The A/D converter measures it as a share of the supply, taken as 5000 mV. The comparator's
 * threshold is absolute: bandgap 1.0 … 1.2 V and an offset of 40 mV. With a supply of 4.5 … 5.5 V it reads as
 * 873 … 1378 mV, so that it lies between "closed" and "open" on every board. */
#define SUPPLY_MV 5000UL
#define CLOSED_BELOW_MV 500
#define OPEN_FROM_MV 1400
#define OPEN_TO_MV 2500
#define BROKEN_ABOVE_MV 4000

/* Equal A/D samples (104 µs each) before a level counts: single ones lie on the way from one level to another. */
#define STEADY_SAMPLES 4

/* Edges in one pass of the main loop: with more, the comparator chatters, at a loop voltage near its threshold, and would
 * keep the main loop from running. 50 bounces in 2 ms are 23 in the longest pass. */
#define MOST_EDGES 32

/* Cycles from an edge at the comparator's output to its capture: synchroniser and edge detector 3, noise canceller 4. */
#define CAPTURE_DELAY_CYCLES 7

#endif
