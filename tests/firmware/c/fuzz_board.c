/* A board under any order of commands, bytes, times, pressures, switches and full buffers. Whatever comes:

   - it drives only while RAMPING or HOLDING, never with e-stop or a dead pressure sensor, never out of its limits;
   - it is vented as soon as a control tick has seen the pressure 2 kPa beyond a limit, or its host gone;
   - every frame it sends is good, numbered in a row, and no longer than the free buffer. */
#include <string.h>

#include "fuzz.h"
#include "host.h"

static boat board;
static boat_receiver listener;
static uint8_t next_seq;

static void check_sent(void)
{
    const uint8_t *body = NULL;

    for (size_t i = 0; i < host.n_out; i++) {
        size_t length = boat_take_byte(&listener, host.out[i], &body);
        if (length) {
            CHECK(body[0] >= 1 && body[0] <= 4 && body[1] == next_seq);
            next_seq++;
        }
    }
    CHECK(listener.crc_errors + listener.malformed + listener.oversize == 0 && listener.collected == 0);
    CHECK(host.n_out <= host.room);
    host.n_out = 0;
}

static void check_control(void)
{
    const boat_control *control = &board.control;
    int moving = control->state == BOAT_RAMPING || control->state == BOAT_HOLDING;

    CHECK(control->state <= BOAT_FAULT && control->regulated == moving && host.vent == !moving);
    CHECK(moving || host.permille == 0);
    CHECK(host.permille >= -1000 && host.permille <= 1000);
    CHECK(control->min_pa >= host_config.pressure_min_pa && control->max_pa <= host_config.pressure_max_pa);
    CHECK(control->min_pa < control->max_pa);
    CHECK(!moving || (control->target_pa >= control->min_pa && control->target_pa <= control->max_pa));
    CHECK(control->state == BOAT_FAULT || !(control->estop || control->pressure_invalid));
}

/* After a tick the levels have been looked at. */
static void check_interlocks(void)
{
    const boat_control *control = &board.control;

    CHECK(!host.estop || control->state == BOAT_FAULT);
    CHECK(host.pressure_valid || control->state == BOAT_FAULT);
    if (control->state != BOAT_FAULT) {
        CHECK(host.pressure_pa <= control->max_pa + 2000 && host.pressure_pa >= control->min_pa - 2000);
        CHECK(!control->timeout_us || board.tick_us < control->fed_us + control->timeout_us);
    }
}

typedef struct {
    const uint8_t *at, *end;
} input;

static uint32_t take(input *in, size_t bytes)
{
    uint32_t value = 0;

    while (bytes-- && in->at < in->end) {
        value = value << 8 | *in->at++;
    }
    return value;
}

/* A good frame of any type, its payload from the input. */
static void send_command(input *in, uint8_t type)
{
    uint8_t frame[32];
    size_t n = 3;

    frame[1] = type;
    frame[2] = (uint8_t)take(in, 1);
    for (size_t left = take(in, 1) % 12; left; left--) {
        frame[n++] = (uint8_t)take(in, 1);
    }
    boat_receive(&board, frame, boat_seal(frame, n - 1));
}

/* SET_PRESSURE or SET_LIMITS with values that a host may mean. */
static void send_pressures(input *in, uint8_t type)
{
    uint8_t frame[32];
    int32_t first = (int32_t)take(in, 2) * 2 - 65536, second = (int32_t)take(in, 2) * 2 - 65536;
    size_t n = 3;

    frame[1] = type;
    frame[2] = (uint8_t)take(in, 1);
    for (size_t i = 0; i < 4; i++) {
        frame[n + i] = (uint8_t)((uint32_t)first >> (8 * i));
        frame[n + 4 + i] = (uint8_t)((uint32_t)second >> (8 * i));
    }
    boat_receive(&board, frame, boat_seal(frame, n + 7));
}

static void send_raw(input *in)
{
    uint8_t raw[16];
    size_t n = 0;

    while (n < sizeof raw && in->at < in->end) {
        raw[n++] = (uint8_t)take(in, 1);
    }
    boat_receive(&board, raw, n);
}

static void pass_time(uint32_t time_us)
{
    uint64_t before = board.tick_us;

    host.clock_us += time_us;
    host_plant(time_us / 1e6);
    boat_poll(&board);
    if (board.tick_us != before) {
        check_interlocks();
    }
}

static void step(input *in)
{
    uint32_t order = take(in, 1);

    switch (order % 12) {
    case 0: send_command(in, (uint8_t)take(in, 1)); break;
    case 1: case 2: send_command(in, (uint8_t)(0x81 + order / 12 % 8)); break;
    case 3: send_pressures(in, 0x84); break;
    case 4: send_pressures(in, 0x88); break;
    case 5: send_raw(in); break;
    case 6: case 7: case 8: pass_time(take(in, 2) * (order / 12 + 1)); break;
    case 9: host.estop = order / 12 == 0; host.pressure_valid = order / 12 != 1; break;
    case 10: host.kpa = (int16_t)take(in, 2) / 300.0; host_plant(0.0); break;
    default: host.room = take(in, 1) * 2; break;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    input in = {data, data + size};

    host_reset();
    memset(&listener, 0, sizeof listener);
    next_seq = 0;
    host.clock_us = take(&in, 4);
    host_config.n_sensors = (uint8_t)(1 + host.clock_us % 4);
    boat_init(&board, &host_config, &host_hardware, (boat_boot_reason)(host.clock_us % 5));
    check_sent();
    while (in.at < in.end) {
        step(&in);
        check_sent();
        check_control();
    }
    return 0;
}
