/* A carriage with three end switches for firmware that has none, to be linked into it.

   Call carriage_made at each step of an axis (0 to 2); its bits are the switches that are pressed.
   The carriage stands some way below its switches when power comes on, whatever the firmware counts,
   and goes by the steps that are made. Switches are at the positive ends; each trips SCATTER steps
   early or late, another way at each approach. Where it is (steps) stands in the file `carriage`. */

#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#define STEPS_MM 800
#define SCATTER 8

int carriage_made(int axis, int steps)
{
    static int32_t *carriage;
    static int trip[3], pressed;

    if (!carriage) {
        int file = open("carriage", O_RDWR | O_CREAT | O_TRUNC, 0644);
        if (ftruncate(file, 3 * sizeof *carriage))
            exit(1);
        carriage = mmap(0, 3 * sizeof *carriage, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
        carriage[0] = carriage[1] = -20 * STEPS_MM;
        carriage[2] = -10 * STEPS_MM;
    }
    carriage[axis] += steps;
    if (carriage[axis] < -STEPS_MM / 2 && !(pressed >> axis & 1))
        trip[axis] = rand() % (2 * SCATTER + 1) - SCATTER;
    pressed = (pressed & ~(1 << axis)) | (carriage[axis] >= trip[axis]) << axis;
    return pressed;
}
