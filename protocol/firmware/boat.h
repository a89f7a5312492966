/* The board's half of the BOAT link, version 1 (SPEC.md), for any microcontroller with a C99 compiler.

   No allocation, no library, no interrupt of its own: the main loop calls `boat_poll` as often as it can (every
   millisecond or faster) and `boat_receive` with what has come in; everything else goes through `boat_hardware`.
   A `boat` belongs to one loop; neither function may be called from an interrupt while the other runs. */
#ifndef BOAT_H
#define BOAT_H

#include "boat_control.h"
#include "boat_frame.h"

#define BOAT_SENSORS_MAX 4u
#define BOAT_EVENTS_MAX 8u
/* A SAMPLE leaves so much of the transmit buffer free: a HELLO and an EVENT still find room behind it. */
#define BOAT_ROOM_FOR_MESSAGES 64u
#define BOAT_FRAME_MAX (2u + 34u + BOAT_SEAL_ROOM) /* HELLO, the longest */

typedef enum { BOAT_POWER, BOAT_WATCHDOG, BOAT_BROWN_OUT, BOAT_RESET_PIN, BOAT_SOFTWARE } boat_boot_reason;

typedef struct {
    uint32_t time_us;
    int32_t value;
    uint8_t code;
} boat_event;

typedef struct {
    const boat_config *config;
    const boat_hardware *hardware;
    boat_receiver receiver;
    boat_control control;
    uint64_t now_us; /* since boot, on top of the clock's value then: the low half is the clock */
    uint64_t tick_us;
    /* the last command, to be answered again and not obeyed again */
    bool answered;
    uint8_t answered_type;
    uint8_t answered_seq;
    uint8_t answered_status;
    /* sending */
    uint8_t seq;
    uint8_t boot_reason;
    uint8_t events_first;
    uint8_t events_waiting;
    boat_event events[BOAT_EVENTS_MAX];
    uint32_t messages_lost; /* answers and events that found no room */
    /* sampling: instant `index` is at `due_us`; `due_rest` carries what a whole microsecond cannot */
    uint16_t rate_hz; /* 0 = none */
    uint32_t index;
    uint32_t dropped;
    uint32_t due_rest;
    uint64_t due_us;
    uint64_t quiet_until_us[BOAT_SENSORS_MAX]; /* a sensor that saturates again sooner has not stopped */
} boat;

/* Boot: levels are looked at, HELLO and EVENT 1 are sent. `config` and `hardware` are kept, not copied. */
void boat_init(boat *board, const boat_config *config, const boat_hardware *hardware, boat_boot_reason reason);

/* Take bytes from the host and obey what is in them. */
void boat_receive(boat *board, const uint8_t *data, size_t n);

/* Do whatever is due: control every 10 ms, samples at their instants, messages that waited for room. */
void boat_poll(boat *board);

#endif
