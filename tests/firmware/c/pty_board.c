/* The firmware as a board on a pseudo-terminal: SPEED [LOG]. Prints the port's name, then serves until it is killed;
   to LOG goes every byte that was written to the port.

   Board time follows the wall's, SPEED times as fast, in steps of at most 20 ms of wall time. A fast board does not
   take a busy computer for a dead host: before its watchdog it waits up to half a second of wall time for a host that
   has the port open. Without one there is no space to transmit, as on USB while DTR is low. */
#define _DEFAULT_SOURCE
#define _XOPEN_SOURCE 700

#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "host.h"

#define LONGEST_STEP_S 0.02
#define GRACE_S 0.5

static boat board;
static int port;
static FILE *sent;

static double wall_s(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Raw before a byte is sent, else the terminal echoes; and nothing of the past for the next host. */
static void make_raw_and_empty(void)
{
    struct termios settings;
    int terminal = open(ptsname(port), O_RDWR | O_NOCTTY);

    if (terminal < 0 || tcgetattr(terminal, &settings)) {
        exit(2);
    }
    cfmakeraw(&settings);
    tcsetattr(terminal, TCSANOW, &settings);
    tcflush(terminal, TCIOFLUSH);
    close(terminal);
}

static void open_port(void)
{
    port = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (port < 0 || grantpt(port) || unlockpt(port)) {
        exit(2);
    }
    make_raw_and_empty();
    puts(ptsname(port));
    fflush(stdout);
}

/* Exchange bytes with the host; true while one has the port open. */
static bool exchange(double *heard_s)
{
    static bool connected;
    struct pollfd wanted = {port, POLLIN, 0};
    uint8_t data[4096];
    ssize_t n;

    poll(&wanted, 1, 2);
    if (wanted.revents & POLLIN && (n = read(port, data, sizeof data)) > 0) {
        boat_receive(&board, data, (size_t)n);
        *heard_s = wall_s();
    }
    if (wanted.revents & POLLHUP) {
        if (connected) {
            make_raw_and_empty();
        }
        host.n_out = 0;
        nanosleep(&(struct timespec){0, 2000000}, NULL);
    } else if (host.n_out && (n = write(port, host.out, host.n_out)) > 0) {
        if (sent) {
            fwrite(host.out, 1, (size_t)n, sent);
            fflush(sent);
        }
        memmove(host.out, host.out + n, host.n_out -= (size_t)n);
    }
    connected = !(wanted.revents & POLLHUP);
    host.room = connected ? HOST_TX_MAX : 0;
    return connected;
}

/* Go from instant to instant: control ticks, and samples between them. */
static void advance_to(uint64_t end_us)
{
    while (host.clock_us < end_us) {
        uint64_t tick_us = board.tick_us + BOAT_TICK_US, next_us = tick_us < end_us ? tick_us : end_us;

        if (board.rate_hz && board.due_us < next_us) {
            next_us = board.due_us;
        }
        host.clock_us = next_us;
        if (next_us == tick_us) {
            host_plant(BOAT_TICK_US / 1e6);
        }
        boat_poll(&board);
    }
}

int main(int argc, char **argv)
{
    double speed = argc > 1 ? atof(argv[1]) : 1.0, heard_s = 0.0, origin_s;

    sent = argc > 2 ? fopen(argv[2], "wb") : NULL;
    host_reset();
    host.room = 0;
    boat_init(&board, &host_config, &host_hardware, BOAT_POWER);
    open_port();
    origin_s = wall_s();
    for (;;) {
        bool connected = exchange(&heard_s);
        double now_s = wall_s(), late_s = now_s - origin_s - (double)host.clock_us / 1e6 / speed;
        double step_s = late_s < LONGEST_STEP_S ? late_s : LONGEST_STEP_S;
        uint64_t end_us = host.clock_us + (uint64_t)(step_s > 0.0 ? step_s * speed * 1e6 : 0.0);
        const boat_control *control = &board.control;
        uint64_t watchdog_us = control->fed_us + control->timeout_us;

        if (speed > 1.0) {
            if (control->timeout_us && connected && now_s - heard_s < GRACE_S && end_us >= watchdog_us) {
                end_us = watchdog_us - 1;
            }
            origin_s += late_s - (double)(end_us - host.clock_us) / 1e6 / speed;
        }
        advance_to(end_us);
    }
}
