/* As much of an ATmega328P as GRBL 1.1 touches: registers that are plain memory, interrupts that
   are functions. It stands for <avr/...> and <util/delay.h>; avr.c plays the rest. */

#ifndef avr_h
#define avr_h
#include <stdint.h>

#define R8(name) extern volatile uint8_t name;
#define REGISTERS                                                                                 \
    R8(DDRB) R8(DDRC) R8(DDRD) R8(PINB) R8(PINC) R8(PORTB) R8(PORTC) R8(PORTD) R8(MCUSR)          \
    R8(WDTCSR) R8(OCR0A) R8(OCR2A) R8(PCICR) R8(PCMSK0) R8(PCMSK1) R8(TCCR0A) R8(TCCR0B)          \
    R8(TCCR1A) R8(TCCR1B) R8(TCCR2A) R8(TCCR2B) R8(TCNT0) R8(TIMSK0) R8(TIMSK1) R8(UBRR0H)        \
    R8(UBRR0L) R8(UCSR0A) R8(UCSR0B) R8(UDR0) R8(SREG)
REGISTERS
extern volatile uint16_t OCR1A;

enum {
    COM1A0 = 6, COM1A1 = 7, COM1B0 = 4, COM1B1 = 5, COM2A1 = 7, CS01 = 1, CS10 = 0, CS11 = 1,
    CS12 = 2, CS20 = 0, CS21 = 1, CS22 = 2, OCIE0A = 1, OCIE0B = 2, OCIE1A = 1, PCIE0 = 0,
    PCIE1 = 1, RXCIE0 = 7, RXEN0 = 4, TOIE0 = 0, TXEN0 = 3, U2X0 = 1, UDRIE0 = 5, WGM10 = 0,
    WGM11 = 1, WGM12 = 3, WGM13 = 4, WGM20 = 0, WGM21 = 1, WDRF = 3, WDCE = 4, WDE = 3, WDP0 = 0
};

#define ISR(vector) void vector(void)
#define PROGMEM
#define __flash
#define PSTR(text) (text)
#define pgm_read_byte_near(at) (*(const char *)(at))
void cli(void);
void sei(void);
void _delay_us(double us);
#define _delay_ms(ms) _delay_us(1000.0 * (ms))
#endif
