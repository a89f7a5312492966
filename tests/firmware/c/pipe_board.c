/* The firmware at a pipe: one request per line in, and for each a line out with the bytes transmitted meanwhile.

     Z                reset the simulated hardware
     B REASON CLOCK   boot, the clock showing CLOCK microseconds
     R HEX            receive bytes
     T PA PA ...      a control tick (10 ms) for each PA, the pressure found at that tick; samples on the way
     J N              the main loop comes back after N microseconds, once
     G N              N control ticks on the plant of host.c
     P PA  V 0|1  E 0|1  S MASK   pressure, its validity, e-stop, saturated sensors; then a poll
     D N              no space for the next N samples
     M BYTES          size of the transmit buffer, which every line of output empties
     L LEAK REACH     the plant's leak, share per second, and the pumps' reach, kPa
     N SENSORS        number of sensors, from the next boot on
     F HEX            what a receiver finds: "FRAMES CRC_ERRORS MALFORMED OVERSIZE BODY", BODY the last one
     Q                "PA PERMILLE VENT STATE" */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "host.h"

static boat board;
static char line[1u << 20];
static uint8_t bytes[sizeof line / 2];

static size_t read_hex(const char *text)
{
    size_t n = 0;
    unsigned byte;

    while (sscanf(text, "%2x", &byte) == 1) {
        bytes[n++] = (uint8_t)byte;
        text += 2;
    }
    return n;
}

static void print_hex(const uint8_t *data, size_t n)
{
    static const char digits[] = "0123456789abcdef";

    for (; n--; data++) {
        putchar(digits[*data >> 4]);
        putchar(digits[*data & 15]);
    }
}

static void poll(void)
{
    uint32_t passed = board.index;

    boat_poll(&board);
    passed = board.index - passed;
    host.drop_samples -= passed < host.drop_samples ? passed : host.drop_samples;
}

/* Every sample before the next tick at its very instant, then the tick with the pressure found there. */
static void run_tick(int32_t pressure_pa)
{
    uint64_t end_us = host.clock_us + BOAT_TICK_US;

    while (board.rate_hz && board.due_us < end_us) {
        host.clock_us = board.due_us;
        poll();
    }
    host.clock_us = end_us;
    host.pressure_pa = pressure_pa;
    poll();
}

static void run_ticks(char *text)
{
    char *end;
    long pressure_pa = strtol(text, &end, 10);

    while (end != text) {
        run_tick((int32_t)pressure_pa);
        text = end;
        pressure_pa = strtol(text, &end, 10);
    }
}

static void check_receiver(void)
{
    boat_receiver receiver = {0};
    const uint8_t *body = NULL;
    uint8_t last[BOAT_BODY_MAX];
    size_t n = read_hex(line + 2), i, length, n_last = 0;

    for (i = 0; i < n; i++) {
        length = boat_take_byte(&receiver, bytes[i], &body);
        if (length) {
            memcpy(last, body, length);
            n_last = length;
        }
    }
    printf("%" PRIu32 " %" PRIu32 " %" PRIu32 " %" PRIu32 " ", receiver.frames, receiver.crc_errors,
           receiver.malformed, receiver.oversize);
    print_hex(last, n_last);
}

static void boot(void)
{
    unsigned reason;
    unsigned long clock_us;

    if (sscanf(line + 2, "%u %lu", &reason, &clock_us) == 2) {
        host.clock_us = clock_us;
        boat_init(&board, &host_config, &host_hardware, (boat_boot_reason)reason);
    }
}

static void print_gauge(void)
{
    printf("%" PRId32 " %" PRId32 " %d %d", host.pressure_pa, host.permille, host.vent, (int)board.control.state);
}

static void obey(void)
{
    long value = strtol(line + 1, NULL, 10);

    switch (line[0]) {
    case 'Z': host_reset(); break;
    case 'B': boot(); break;
    case 'R': boat_receive(&board, bytes, read_hex(line + 2)); break;
    case 'T': run_ticks(line + 1); break;
    case 'G': while (value--) { host_plant(BOAT_TICK_US / 1e6); run_tick(host.pressure_pa); } break;
    case 'J': host.clock_us += (uint64_t)value; poll(); break;
    case 'P': host.pressure_pa = (int32_t)value; poll(); break;
    case 'V': host.pressure_valid = value; poll(); break;
    case 'E': host.estop = value; poll(); break;
    case 'S': host.saturated = (uint8_t)value; break;
    case 'D': host.drop_samples += (uint32_t)value; break;
    case 'M': host.room = (size_t)value; break;
    case 'L': sscanf(line + 1, "%lf %lf", &host.leak_per_s, &host.reach_kpa); break;
    case 'N': host_config.n_sensors = (uint8_t)value; break;
    case 'F': check_receiver(); break;
    case 'Q': print_gauge(); break;
    default: exit(2);
    }
}

int main(void)
{
    host_reset();
    while (fgets(line, sizeof line, stdin)) {
        obey();
        print_hex(host.out, host.n_out);
        host.n_out = 0;
        putchar('\n');
        fflush(stdout);
    }
    return 0;
}
