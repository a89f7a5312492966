/* A driver for a fuzz target where there is no libFuzzer: SECONDS SEED; prints how many inputs were tried.

   Inputs are kept frames and orders of the target's own past, cut, joined, repeated, flipped and made up. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "boat_frame.h"
#include "fuzz.h"

#define KEPT 64
#define LONGEST 700

static uint64_t state;

static uint32_t roll(uint32_t sides)
{
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(state >> 33) % sides;
}

static size_t make_up(uint8_t *data)
{
    size_t n = roll(4) ? roll(60) : roll(LONGEST);

    for (size_t i = 0; i < n; i++) {
        data[i] = (uint8_t)(roll(6) ? roll(256) : 0);
    }
    return n;
}

/* A good frame of any length, or one with a good checksum that a receiver must refuse. */
static size_t make_frame(uint8_t *data)
{
    size_t n = roll(5) ? roll(30) : 190 + roll(7);

    for (size_t i = 1; i <= n; i++) {
        data[i] = (uint8_t)(roll(3) ? roll(256) : 0);
    }
    return boat_seal(data, n);
}

static size_t mutate(uint8_t *data, size_t n)
{
    for (uint32_t left = roll(4); left && n; left--) {
        size_t at = roll((uint32_t)n);
        switch (roll(4)) {
        case 0: data[at] ^= (uint8_t)(1u << roll(8)); break;
        case 1: memmove(data + at, data + at + 1, --n - at); break;
        case 2: data[at] = (uint8_t)roll(256); break;
        default: n = at; break;
        }
    }
    return n;
}

int main(int argc, char **argv)
{
    static uint8_t kept[KEPT][LONGEST], data[4 * LONGEST];
    static size_t lengths[KEPT];
    unsigned long tried = 0;
    double seconds = argc > 1 ? atof(argv[1]) : 1.0;
    clock_t end;

    state = argc > 2 ? strtoull(argv[2], NULL, 10) : 0;
    end = clock() + (clock_t)(seconds * CLOCKS_PER_SEC);
    while (clock() < end) {
        size_t n = 0;
        for (uint32_t parts = 1 + roll(3); parts; parts--) {
            uint32_t slot = roll(KEPT);
            if (lengths[slot] == 0 || roll(3) == 0) {
                lengths[slot] = roll(2) ? make_up(kept[slot]) : make_frame(kept[slot]);
            }
            memcpy(data + n, kept[slot], lengths[slot]);
            n += lengths[slot];
        }
        n = mutate(data, n);
        uint8_t *exact = malloc(n ? n : 1); /* so that a byte read beyond the end is seen */
        if (!exact) {
            return 2;
        }
        memcpy(exact, data, n);
        LLVMFuzzerTestOneInput(exact, n);
        free(exact);
        tried++;
    }
    printf("%lu\n", tried);
    return 0;
}
