#include "line.h"

#include <string.h>
#include <util/crc16.h>

#include "uart.h"

static uint16_t crc;

/* CRC-16/CCITT-FALSE: avr-libc calls the polynomial 1021, not reflected, by XMODEM's name; the start is ours. */
#define CRC_START 0xFFFF

static void begin_crc(void)
{
    crc = CRC_START;
}

static void put(char character)
{
    crc = _crc_xmodem_update(crc, character);
    uart_send(character);
}

static void put_text(PGM_P text)
{
    for (char character; (character = pgm_read_byte(text)); text++)
        put(character);
}

/* By subtraction: a 32-bit division takes 600 cycles, a character on the line 640. */
static void put_number(uint32_t number)
{
    static const uint32_t powers[] PROGMEM = {1000000000, 100000000, 10000000, 1000000, 100000, 10000, 1000, 100, 10};
    bool leading = true;
    for (uint8_t k = 0; k < sizeof powers / sizeof *powers; k++) {
        uint32_t power = pgm_read_dword(&powers[k]);
        char digit = '0';
        for (; number >= power; number -= power)
            digit++;
        leading = leading && digit == '0';
        if (!leading)
            put(digit);
    }
    put('0' + (uint8_t)number);
}

void line_begin(PGM_P kind, uint16_t seq)
{
    char first = pgm_read_byte(kind);
    tick_t tick = uart_begin(first);
    begin_crc();
    crc = _crc_xmodem_update(crc, first);
    put_text(kind + 1);
    line_field(seq);
    line_field(tick);
}

void line_field(uint32_t number)
{
    put(',');
    put_number(number);
}

void line_text_field(PGM_P text)
{
    put(',');
    put_text(text);
}

void line_end(void)
{
    uart_send('*');
    for (uint8_t k = 0; k < 4; k++) {
        uint8_t digit = crc >> 12;
        crc <<= 4;
        uart_send(digit < 10 ? '0' + digit : 'A' + digit - 10);
    }
    uart_send('\n');
}

/* Reading */

volatile uint16_t lines_dropped;

static const char names[][7] PROGMEM = {
    [COMMAND_ACK] = "ACK",
    [COMMAND_HELLO] = "HELLO",
    [COMMAND_ARM] = "ARM",
    [COMMAND_DISARM] = "DISARM",
    [COMMAND_SYNC] = "SYNC",
};

static bool is_digit(char character)
{
    return character >= '0' && character <= '9';
}

static enum command command_of(const char *text, uint8_t length)
{
    for (uint8_t command = 0; command < COMMAND_UNKNOWN; command++)
        if (length == strlen_P(names[command]) && memcmp_P(text, names[command], length) == 0)
            return command;
    return COMMAND_UNKNOWN;
}

/* The four upper-case hexadecimal digits at `text` are the check sum of the `length` characters at `body`. */
static bool check_sum_fits(const char *body, uint8_t length, const char *text)
{
    uint16_t stated = 0, sum = CRC_START;
    for (uint8_t k = 0; k < 4; k++) {
        char character = text[k];
        if (is_digit(character))
            stated = stated << 4 | (character - '0');
        else if (character >= 'A' && character <= 'F')
            stated = stated << 4 | (character - 'A' + 10);
        else
            return false;
    }
    while (length--)
        sum = _crc_xmodem_update(sum, *body++);
    return sum == stated;
}

/* `TYPE,seq`, further fields only behind an unknown type, `*CRC`. */
static bool parse(const char *text, uint8_t length, struct host_line *line)
{
    if (length > 0 && text[length - 1] == '\r')
        length--;
    if (length < 5)
        return false;
    uint8_t body = length - 5, k = 0;
    if (text[body] != '*' || memchr(text, '*', body) || memchr(text, 0, body))
        return false;
    while (k < body && text[k] >= 'A' && text[k] <= 'Z')
        k++;
    if (k == 0 || k == body || text[k] != ',')
        return false;
    line->command = command_of(text, k);
    const char *digits = text + ++k;
    uint32_t seq = 0;
    for (; k < body && is_digit(text[k]); k++) {
        seq = seq * 10 + (text[k] - '0');
        if (seq > UINT16_MAX)
            return false;
    }
    uint8_t count = text + k - digits;
    if (count == 0 || (*digits == '0' && count > 1))
        return false;
    if (k < body && (text[k] != ',' || line->command != COMMAND_UNKNOWN))
        return false;
    line->seq = seq;
    return check_sum_fits(text, body, text + body + 1);
}

bool line_receive(struct host_line *line)
{
    static char text[LINE_LONGEST];
    static uint8_t length;
    static bool overlong;
    for (char character; uart_read(&character);) {
        if (character == '\n') {
            bool valid = !overlong && parse(text, length, line);
            length = 0;
            overlong = false;
            if (valid) {
                line->received = uart_newline_tick();
                return true;
            }
            lines_dropped++;
        } else if (length < LINE_LONGEST) {
            text[length++] = character;
        } else {
            overlong = true;
        }
    }
    return false;
}
