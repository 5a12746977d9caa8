// SPDX-License-Identifier: GPL-3.0-or-later
// The A/D converter (24): the voltage counts at sample and hold, not when the result is read.
#include "chip.h"

static avr_adc_t *adc;
static bool first_conversion;
static uint16_t sample;

static void convert(cycles now) {
    unsigned power = avr->data[ADCSRA_] & 7;
    cycles clock = power ? 1u << power : 2;
    cycles start = (now + clock - 1) / clock * clock;
    set_due(SAMPLED, start + (first_conversion ? 27 : 3) * clock / 2);
    set_due(CONVERTED, start + (first_conversion ? 25 : 13) * clock);
    first_conversion = false;
}

void hold_sample(void) {
    uint8_t admux = avr->data[ADMUX_], channel = admux & 15;
    uint32_t reference = admux >> 6 == 3 ? bandgap_mv : 5000;
    uint32_t input = channel < 8 ? millivolts : channel == 14 ? bandgap_mv : 0;
    uint32_t value = input * 1024 / reference;
    sample = value > 1023 ? 1023 : value;
    if (admux & 0x20) sample <<= 6;
    set_due(SAMPLED, NEVER);
}

void converted(cycles when) {
    avr->data[ADCL_] = sample;
    avr->data[ADCH_] = sample >> 8;
    avr->data[ADCSRA_] &= ~ADSC;
    set_due(CONVERTED, NEVER);
    avr_raise_interrupt(avr, &adc->adc);
    if (avr->data[ADCSRA_] & ADATE) {
        if (avr->data[ADCSRB_] & 7) fail("the A/D converter's trigger is not modelled");
        avr->data[ADCSRA_] |= ADSC;
        convert(when);
    }
}

static void write_adcsra(avr_t *core, avr_io_addr_t address, uint8_t value, void *unused) {
    (void)unused;
    uint8_t old = core->data[address];
    if (value & ADIF) {
        avr_clear_interrupt(core, &adc->adc);
        value &= ~ADIF;
    } else {
        value |= old & ADIF;
    }
    if (!(value & ADEN)) {
        set_due(SAMPLED, NEVER);
        set_due(CONVERTED, NEVER);
        core->data[address] = value & ~ADSC;
        return;
    }
    if (!(old & ADEN)) first_conversion = true;
    core->data[address] = value | (old & ADSC);
    if ((value & ADSC) && !(old & ADSC)) convert(core->cycle);
    raise_if(&adc->adc, (core->data[address] & ADIF) && avr_regbit_get(core, adc->adc.enable));
}

void converter_reset(void) {
    set_due(SAMPLED, NEVER);
    set_due(CONVERTED, NEVER);
}

void converter_take_over(void) {
    adc = module_of("adc", 0);
    take(ADCSRA_, NULL, write_adcsra), take(ADCSRB_, NULL, write_plain);
    take(ADCL_, read_plain, NULL), take(ADCH_, read_plain, NULL);
}
