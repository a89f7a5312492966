/* Runs the header on a Cortex-M3 (QEMU, mps2-an385) or on the host: the same signals, results into results.bin.
 *
 * On the target it also prints the instructions of a call: QEMU with -icount shift=0 counts one a nanosecond, and
 * SysTick counts one in 40 (25 MHz). */
#include <stdint.h>
#include "boat_calibration.h"

#define CALLS 100000

static uint32_t state = 1u;

static double uniform(void)
{
    state = state * 1664525u + 1013904223u;
    return (double)(state >> 8) / 16777216.0;
}

/* Signals of one elongation, 8 % beyond the range on either side, and some noise of each sensor. */
static void next_signals(float *signals_mv)
{
    const double share = -0.08 + 1.16 * uniform();
    int i;
    for (i = 0; i < BOAT_SENSORS; ++i) {
        const double low = (double)boat_sensors[i].low_mv, high = (double)boat_sensors[i].high_mv;
        signals_mv[i] = (float)(low + share * (high - low) + 6.0 * (uniform() - 0.5));
    }
}

static float results[2 * 1000];

#ifdef HOST
#include <stdio.h>

int main(void)
{
    FILE *file = fopen("results.bin", "wb");
    int call, i = 0;
    for (call = 0; call < CALLS; ++call) {
        float signals_mv[BOAT_SENSORS];
        next_signals(signals_mv);
        results[i] = boat_elongation_mm(signals_mv, &results[i + 1]);
        i += 2;
        if (i == 2 * 1000) {
            fwrite(results, sizeof results, 1, file);
            i = 0;
        }
    }
    return fclose(file);
}
#else
#define SYSTICK ((volatile uint32_t *)0xE000E010u)

static int semihosting(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void print(uint32_t value)
{
    char text[12];
    int i = 11;
    text[i] = 0;
    do {
        text[--i] = (char)('0' + value % 10u);
        value /= 10u;
    } while (value > 0u);
    text[--i] = ' ';
    semihosting(4, text + i);
}

void reset(void);
__attribute__((section(".vectors"), used)) const uintptr_t vectors[4] = {
    0x20400000u, (uintptr_t)&reset, (uintptr_t)&reset, (uintptr_t)&reset};

void reset(void)
{
    static const char name[] = "results.bin";
    const uint32_t opened[3] = {(uint32_t)name, 5u, sizeof name - 1};
    const uint32_t handle = (uint32_t)semihosting(1, opened);
    uint32_t most = 0u, sum = 0u;
    int call, i = 0;
    SYSTICK[1] = 0xFFFFFFu;
    SYSTICK[2] = 0u;
    SYSTICK[0] = 5u;
    for (call = 0; call < CALLS; ++call) {
        float signals_mv[BOAT_SENSORS];
        uint32_t before, ticks;
        next_signals(signals_mv);
        before = SYSTICK[2];
        results[i] = boat_elongation_mm(signals_mv, &results[i + 1]);
        ticks = (before - SYSTICK[2]) & 0xFFFFFFu;
        most = ticks > most ? ticks : most;
        sum += ticks;
        i += 2;
        if (i == 2 * 1000) {
            const uint32_t written[3] = {handle, (uint32_t)results, sizeof results};
            semihosting(5, written);
            i = 0;
        }
    }
    print(sum / (CALLS / 40));
    print(40u * most);
    semihosting(2, &handle);
    semihosting(0x18, (const void *)0x20026);
    for (;;) {
    }
}
#endif
