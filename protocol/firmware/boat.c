#include "boat.h"

#define PROTOCOL_VERSION 1u
#define SATURATION_QUIET_US 1000000u
#define EVENT_LENGTH (2u + 9u + BOAT_SEAL_ROOM)

/* messages of the board */
#define HELLO 0x01u
#define SAMPLE 0x02u
#define ACK 0x03u
#define EVENT 0x04u

/* commands of the host */
#define IDENTIFY 0x81u
#define START 0x82u
#define STOP 0x83u
#define SET_PRESSURE 0x84u
#define VENT 0x85u
#define HEARTBEAT 0x86u
#define CLEAR_FAULT 0x87u
#define SET_LIMITS 0x88u

/* ---- little-endian fields ---------------------------------------------------------------------------------------- */

static uint8_t *put(uint8_t *at, uint32_t value, size_t bytes)
{
    size_t i;

    for (i = 0; i < bytes; i++) {
        at[i] = (uint8_t)(value >> (8u * i));
    }
    return &at[bytes];
}

static uint32_t get(const uint8_t *at, size_t bytes)
{
    uint32_t value = 0;
    size_t i;

    for (i = 0; i < bytes; i++) {
        value |= (uint32_t)at[i] << (8u * i);
    }
    return value;
}

/* Two's complement without leaning on how a compiler converts what does not fit. */
static int32_t get_signed(const uint8_t *at)
{
    uint32_t value = get(at, 4);

    return (value <= (uint32_t)INT32_MAX) ? (int32_t)value : (-(int32_t)(uint32_t)(UINT32_MAX - value) - 1);
}

/* ---- sending ----------------------------------------------------------------------------------------------------- */

/* Send frame[3] .. `end` as the payload of a frame of `type`. */
static void send(boat *board, uint8_t type, uint8_t *frame, const uint8_t *end)
{
    ptrdiff_t length = end - &frame[1]; /* cppcheck-suppress misra-c2012-18.4 ; advisory: both in one array */

    frame[1] = type;
    frame[2] = board->seq;
    board->seq++;
    board->hardware->transmit(frame, boat_seal(frame, (size_t)length));
}

/* Send what waits, as far as there is room; true when nothing waits any more. */
static bool flush_events(boat *board)
{
    while (board->events_waiting != 0u) {
        uint8_t frame[EVENT_LENGTH];
        uint8_t *at = &frame[3];
        const boat_event *event = &board->events[board->events_first];

        if (board->hardware->transmit_room() < EVENT_LENGTH) {
            return false;
        }
        at = put(at, event->time_us, 4);
        at = put(at, event->code, 1);
        at = put(at, (uint32_t)event->value, 4);
        send(board, EVENT, frame, at);
        board->events_first = (uint8_t)((board->events_first + 1u) % BOAT_EVENTS_MAX);
        board->events_waiting--;
    }
    return true;
}

/* Tell an event now, or when there is room again; the first ones are kept, for they are the cause. */
static void tell(boat *board, boat_event_code code, int32_t value, uint64_t time_us)
{
    boat_event *event;

    if (board->events_waiting == BOAT_EVENTS_MAX) {
        board->messages_lost++;
        return;
    }
    event = &board->events[(board->events_first + board->events_waiting) % BOAT_EVENTS_MAX];
    event->time_us = (uint32_t)time_us;
    event->code = (uint8_t)code;
    event->value = value;
    board->events_waiting++;
    (void)flush_events(board);
}

/* Send an answer; one that finds no room is asked for again by the host. */
static void answer(boat *board, uint8_t type, uint8_t *frame, const uint8_t *end)
{
    ptrdiff_t length = end - &frame[1]; /* cppcheck-suppress misra-c2012-18.4 ; advisory: both in one array */

    if (flush_events(board) && (board->hardware->transmit_room() >= ((size_t)length + BOAT_SEAL_ROOM))) {
        send(board, type, frame, end);
    } else {
        board->messages_lost++;
    }
}

static void send_hello(boat *board)
{
    const boat_config *config = board->config;
    uint8_t frame[BOAT_FRAME_MAX];
    uint8_t *at = &frame[3];
    size_t i;

    at = put(at, PROTOCOL_VERSION, 1);
    at = put(at, config->fw_major, 1);
    at = put(at, config->fw_minor, 1);
    at = put(at, config->n_sensors, 1);
    at = put(at, config->rate_max_hz, 2);
    at = put(at, config->adc_bits, 1);
    at = put(at, board->boot_reason, 1);
    at = put(at, config->vref_mv, 2);
    at = put(at, (uint32_t)config->pressure_min_pa, 4);
    at = put(at, (uint32_t)config->pressure_max_pa, 4);
    for (i = 0; i < sizeof config->board_id; i++) {
        at[i] = config->board_id[i];
    }
    answer(board, HELLO, frame, &at[i]);
}

/* ---- time and levels --------------------------------------------------------------------------------------------- */

static void read_clock(boat *board)
{
    board->now_us += (uint32_t)(board->hardware->clock_us() - (uint32_t)board->now_us);
}

static void look(boat *board)
{
    boat_event_code code = boat_control_look(&board->control, board->hardware);

    if (code != BOAT_NOTHING) {
        tell(board, code, 0, board->now_us);
    }
}

static void tick(boat *board)
{
    int32_t value;
    boat_event_code code = boat_control_tick(&board->control, board->tick_us, &value);

    if (code != BOAT_NOTHING) {
        tell(board, code, value, board->tick_us);
    }
}

/* ---- samples ----------------------------------------------------------------------------------------------------- */

/* Go to the next sampling instant: instant n is at start + floor(n / rate), without a division that grows. */
static void next_instant(boat *board)
{
    board->index++;
    board->due_us += 1000000u / board->rate_hz;
    board->due_rest += 1000000u % board->rate_hz;
    if (board->due_rest >= board->rate_hz) {
        board->due_rest -= board->rate_hz;
        board->due_us++;
    }
}

static void tell_dropped(boat *board)
{
    if (board->dropped != 0u) {
        tell(board, BOAT_SAMPLES_DROPPED, (int32_t)board->dropped, board->now_us);
        board->dropped = 0;
    }
}

/* Whether a sensor is saturated; each is told when it begins. */
static bool saturated(boat *board, const uint16_t *counts)
{
    uint32_t full = ((uint32_t)1 << board->config->adc_bits) - 1u;
    bool any = false;
    uint8_t i;

    for (i = 0; i < board->config->n_sensors; i++) {
        if ((counts[2u * i] >= full) || (counts[(2u * i) + 1u] >= full)) {
            any = true;
            if (board->now_us >= board->quiet_until_us[i]) {
                tell(board, BOAT_SENSOR_SATURATED, i, board->now_us);
            }
            board->quiet_until_us[i] = board->now_us + SATURATION_QUIET_US;
        }
    }
    return any;
}

static void send_sample(boat *board, uint32_t index)
{
    uint16_t counts[2u * BOAT_SENSORS_MAX];
    uint8_t frame[2u + 14u + (4u * BOAT_SENSORS_MAX) + BOAT_SEAL_ROOM];
    uint8_t *at = &frame[3];
    uint8_t *flags;
    size_t n_counts = 2u * (size_t)board->config->n_sensors;
    size_t length = 2u + 14u + (2u * n_counts) + BOAT_SEAL_ROOM;
    size_t i;

    board->hardware->read_light(counts);
    at = put(at, index, 4);
    at = put(at, (uint32_t)board->now_us, 4);
    at = put(at, (uint32_t)board->control.pressure_pa, 4);
    at = put(at, board->control.state, 1);
    flags = at;
    at = put(at, boat_control_flags(&board->control) | (saturated(board, counts) ? BOAT_SATURATED : 0u), 1);
    for (i = 0; i < n_counts; i++) {
        at = put(at, counts[i], 2);
    }
    if (!flush_events(board) || (board->hardware->transmit_room() < (length + BOAT_ROOM_FOR_MESSAGES))) {
        board->dropped++;
        return;
    }
    if (board->dropped != 0u) {
        *flags |= BOAT_DROPPED;
        tell_dropped(board);
    }
    send(board, SAMPLE, frame, at);
}

/* Sample if an instant has come; an instant that was over before the main loop came here is a dropped sample. */
static void sample(boat *board)
{
    while ((board->rate_hz != 0u) && (board->now_us >= board->due_us)) {
        uint32_t index = board->index;

        next_instant(board);
        if (board->now_us < board->due_us) {
            send_sample(board, index);
        } else {
            board->dropped++;
        }
    }
}

/* ---- commands ---------------------------------------------------------------------------------------------------- */

static boat_status start(boat *board, uint16_t rate_hz)
{
    if ((rate_hz == 0u) || (rate_hz > board->config->rate_max_hz)) {
        return BOAT_OUT_OF_LIMITS;
    }
    tell_dropped(board);
    board->rate_hz = rate_hz;
    board->index = 0;
    board->due_rest = 0;
    board->due_us = board->now_us;
    return BOAT_DONE;
}

static boat_status stop(boat *board)
{
    tell_dropped(board);
    board->rate_hz = 0;
    return BOAT_DONE;
}

static boat_status obey(boat *board, uint8_t type, const uint8_t *payload, size_t n)
{
    static const uint8_t lengths[] = {0, 2, 0, 8, 0, 2, 0, 8};
    boat_control *control = &board->control;

    if (type > SET_LIMITS) {
        return BOAT_UNKNOWN_COMMAND;
    }
    if (n < lengths[type - IDENTIFY]) {
        return BOAT_WRONG_LENGTH;
    }
    switch (type) {
    case START:
        return start(board, (uint16_t)get(payload, 2));
    case STOP:
        return stop(board);
    case SET_PRESSURE:
        return boat_control_set_pressure(control, board->config, board->now_us, get_signed(payload),
                                         get(&payload[4], 4));
    case VENT:
        boat_control_vent(control);
        return BOAT_DONE;
    case HEARTBEAT:
        return boat_control_heartbeat(control, get(payload, 2));
    case CLEAR_FAULT:
        return boat_control_clear_fault(control);
    case SET_LIMITS:
        return boat_control_set_limits(control, board->config, get_signed(payload), get_signed(&payload[4]));
    default: /* IDENTIFY */
        return BOAT_DONE;
    }
}

/* Answer one good frame; the same type and seq twice running is obeyed once. */
static void handle(boat *board, const uint8_t *body, size_t n)
{
    uint8_t frame[2u + 3u + BOAT_SEAL_ROOM];
    uint8_t *at = &frame[3];
    uint8_t type = body[0];
    uint8_t seq = body[1];

    if (type < IDENTIFY) { /* not from a host */
        return;
    }
    board->control.fed_us = board->now_us;
    look(board);
    if (!board->answered || (type != board->answered_type) || (seq != board->answered_seq)) {
        board->answered_status = (uint8_t)obey(board, type, &body[2], n - 2u);
    }
    board->answered = true;
    board->answered_type = type;
    board->answered_seq = seq;
    boat_control_drive(&board->control, board->config, board->hardware);
    if (type == IDENTIFY) {
        send_hello(board);
        return;
    }
    at = put(at, type, 1);
    at = put(at, seq, 1);
    at = put(at, board->answered_status, 1);
    answer(board, ACK, frame, at);
}

/* ---- what the main loop calls ------------------------------------------------------------------------------------ */

void boat_init(boat *board, const boat_config *config, const boat_hardware *hardware, boat_boot_reason reason)
{
    uint8_t i;

    board->config = config;
    board->hardware = hardware;
    board->boot_reason = (uint8_t)reason;
    board->now_us = hardware->clock_us();
    board->tick_us = board->now_us;
    board->receiver.collected = 0;
    board->receiver.skipping = false;
    board->receiver.frames = 0;
    board->receiver.crc_errors = 0;
    board->receiver.malformed = 0;
    board->receiver.oversize = 0;
    board->answered = false;
    board->seq = 0;
    board->events_first = 0;
    board->events_waiting = 0;
    board->messages_lost = 0;
    board->dropped = 0;
    board->index = 0;
    board->due_rest = 0;
    board->rate_hz = 0;
    board->due_us = 0;
    for (i = 0; i < BOAT_SENSORS_MAX; i++) {
        board->quiet_until_us[i] = 0;
    }
    boat_control_boot(&board->control, config);
    (void)boat_control_look(&board->control, hardware); /* an e-stop found pressed is a level, not an event */
    boat_control_drive(&board->control, config, hardware);
    send_hello(board);
    tell(board, BOAT_BOOTED, board->boot_reason, board->now_us);
}

void boat_receive(boat *board, const uint8_t *data, size_t n)
{
    const uint8_t *body;
    size_t i;

    read_clock(board);
    for (i = 0; i < n; i++) {
        size_t length = boat_take_byte(&board->receiver, data[i], &body);

        if (length != 0u) {
            handle(board, body, length);
        }
    }
}

void boat_poll(boat *board)
{
    read_clock(board);
    look(board);
    while ((board->now_us - board->tick_us) >= BOAT_TICK_US) {
        board->tick_us += BOAT_TICK_US;
        tick(board);
    }
    boat_control_drive(&board->control, board->config, board->hardware);
    (void)flush_events(board);
    sample(board);
}
