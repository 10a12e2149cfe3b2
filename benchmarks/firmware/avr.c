/* GRBL 1.1h on a computer: `grbl PORT` serves its serial line on a socket of this machine.

   A timer's signal interrupts the program as the chip's interrupts do. In it, steps that are due are
   made, and bytes move as fast as 115200 baud lets them. What the computer was too late for by more
   than LATE_NS is put off, not made up for. */

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include "grbl.h"

#define TICK_US 500
#define BYTES 6 /* in a tick */
#define LATE_NS 5000000

#undef R8
#define R8(name) volatile uint8_t name;
REGISTERS
volatile uint16_t OCR1A;

void TIMER1_COMPA_vect(void);
void TIMER0_OVF_vect(void);
void PCINT0_vect(void);
void SERIAL_RX(void);
void SERIAL_UDRE(void);
int carriage_made(int axis, int steps);

static int listening, line = -1;
static int64_t step_ns;
static char *memory; /* of the file `eeprom` */

static int64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000LL + t.tv_nsec;
}

#define ENABLED 0x80

void cli(void) { SREG &= ~ENABLED; }

void sei(void) { SREG |= ENABLED; }

static void move(void)
{
    static const uint8_t step[] = {X_STEP_BIT, Y_STEP_BIT, Z_STEP_BIT};
    static const uint8_t back[] = {X_DIRECTION_BIT, Y_DIRECTION_BIT, Z_DIRECTION_BIT};
    static const uint8_t limit[] = {X_LIMIT_BIT, Y_LIMIT_BIT, Z_LIMIT_BIT};
    uint8_t pins = 0xff;
    int pressed = 0;

    for (int a = 0; a < N_AXIS; a++) {
        int made = !(STEP_PORT >> step[a] & 1) ? 0 : DIRECTION_PORT >> back[a] & 1 ? -1 : 1;
        pressed = carriage_made(a, made);
    }
    for (int a = 0; a < N_AXIS; a++)
        if (pressed >> a & 1)
            pins &= ~(1 << limit[a]);
    if (pins != LIMIT_PIN) {
        LIMIT_PIN = pins;
        if (PCICR >> PCIE0 & 1)
            PCINT0_vect();
    }
}

static void talk(void)
{
    uint8_t byte;

    if (line < 0 && (line = accept(listening, 0, 0)) >= 0)
        fcntl(line, F_SETFL, O_NONBLOCK);
    for (int i = 0; i < BYTES && line >= 0; i++) {
        ssize_t n = recv(line, &byte, 1, 0);
        if (n == 1) {
            UDR0 = byte;
            SERIAL_RX();
        } else if (n == 0 || errno != EAGAIN) {
            close(line);
            line = -1;
        }
    }
    for (int i = 0; i < BYTES && UCSR0B >> UDRIE0 & 1; i++) {
        SERIAL_UDRE();
        byte = UDR0;
        if (line >= 0)
            send(line, &byte, 1, MSG_NOSIGNAL);
    }
}

static void tick(int signal)
{
    static int inside;

    (void)signal;
    if (!(SREG & ENABLED) || inside)
        return;
    inside = 1;
    cli();
    int64_t now = now_ns();
    if (step_ns < now - LATE_NS)
        step_ns = now;
    while (TIMSK1 >> OCIE1A & 1 && step_ns <= now) {
        TIMER1_COMPA_vect();
        move();
        TIMER0_OVF_vect();
        step_ns += OCR1A * 1000LL / 16;
    }
    talk();
    inside = 0;
    sei();
}

void _delay_us(double us)
{
    int64_t until = now_ns() + (int64_t)(us * 1000);
    for (int64_t left; (left = until - now_ns()) > 0;)
        nanosleep(&(struct timespec){left / 1000000000, left % 1000000000}, 0);
}

/* The main loop asks for the next byte without end. */
uint8_t grbl_serial_read(void);
uint8_t serial_read(void)
{
    uint8_t data = grbl_serial_read();
    if (data == SERIAL_NO_DATA)
        _delay_us(200);
    return data;
}

unsigned char eeprom_get_char(unsigned int at) { return memory[at]; }

/* It ends with interrupts on, as the chip's does: a first boot relies on that. */
void eeprom_put_char(unsigned int at, unsigned char value)
{
    memory[at] = value;
    sei();
}

void memcpy_to_eeprom_with_checksum(unsigned int to, char *from, unsigned int size)
{
    memcpy(memory + to, from, size);
    eeprom_put_char(to + size, 1);
}

int memcpy_from_eeprom_with_checksum(char *to, unsigned int from, unsigned int size)
{
    memcpy(to, memory + from, size);
    return memory[from + size];
}

int grbl_main(void);
int main(int argc, char **argv)
{
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons(atoi(argv[argc - 1]))};
    struct itimerval every = {{0, TICK_US}, {0, TICK_US}};

    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    listening = socket(AF_INET, SOCK_STREAM, 0);
    setsockopt(listening, SOL_SOCKET, SO_REUSEADDR, &(int){1}, sizeof(int));
    if (bind(listening, (struct sockaddr *)&here, sizeof here) || listen(listening, 1))
        return 1;
    fcntl(listening, F_SETFL, O_NONBLOCK);
    int file = open("eeprom", O_RDWR | O_CREAT, 0644);
    if (ftruncate(file, 1024))
        return 1;
    memory = mmap(0, 1024, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    PINB = PINC = 0xff;
    sigaction(SIGALRM, &(struct sigaction){.sa_handler = tick, .sa_flags = SA_RESTART}, 0);
    setitimer(ITIMER_REAL, &every, 0);
    return grbl_main();
}
