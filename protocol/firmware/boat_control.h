/* State, limits, watchdog and regulator of the board (SPEC.md, "Commands of the host").

   Levels are looked at before every command and every 10 ms, not edges. The board never leaves its limits on command;
   it vents by itself beyond a limit by more than 2 kPa, on a lost heartbeat, the e-stop, a target not reached, a dead
   pressure sensor, and each of these latches FAULT until CLEAR_FAULT finds its cause gone. */
#ifndef BOAT_CONTROL_H
#define BOAT_CONTROL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BOAT_TICK_US 10000u

typedef enum { BOAT_IDLE, BOAT_RAMPING, BOAT_HOLDING, BOAT_VENTED, BOAT_FAULT } boat_state;

typedef enum {
    BOAT_DONE,
    BOAT_UNKNOWN_COMMAND,
    BOAT_WRONG_LENGTH,
    BOAT_OUT_OF_LIMITS,
    BOAT_NOT_IN_THIS_STATE,
    BOAT_FAULT_LATCHED
} boat_status;

/* flags of a SAMPLE */
#define BOAT_SATURATED 1u
#define BOAT_ESTOP 2u
#define BOAT_ARMED 4u
#define BOAT_PRESSURE_INVALID 8u
#define BOAT_DROPPED 16u

typedef enum {
    BOAT_NOTHING,
    BOAT_BOOTED,
    BOAT_OVER_PRESSURE,
    BOAT_UNDER_PRESSURE,
    BOAT_HEARTBEAT_LOST,
    BOAT_ESTOP_PRESSED,
    BOAT_ESTOP_RELEASED,
    BOAT_SENSOR_SATURATED,
    BOAT_TARGET_NOT_REACHED,
    BOAT_SAMPLES_DROPPED
} boat_event_code;

/* What the board is. Fill in before `boat_init`, never change afterwards. */
typedef struct {
    uint8_t fw_major;
    uint8_t fw_minor;
    uint8_t n_sensors;                      /* 1..4 */
    uint8_t adc_bits;                       /* 1..16 */
    uint16_t rate_max_hz;                   /* not 0 */
    uint16_t vref_mv;                       /* mV of 2^adc_bits counts */
    int32_t pressure_min_pa;                /* hard limits, within +-2 MPa */
    int32_t pressure_max_pa;
    uint32_t ramp_max_pa_per_s;             /* what the pumps do at full drive; 1..4 000 000 */
    uint16_t gain_permille_per_kpa;         /* drive for each kPa that the pressure lags behind */
    uint8_t board_id[16];                   /* ASCII, NUL-padded */
} boat_config;

/* What the board can do; all seven are needed, none may block for long. */
typedef struct {
    uint32_t (*clock_us)(void);              /* free running, wraps at 2^32 */
    bool (*read_pressure)(int32_t *pressure_pa); /* gauge; false if the sensor cannot be believed */
    void (*read_light)(uint16_t *counts);    /* lit, dark of sensor 1, lit, dark of sensor 2, ... */
    bool (*estop_pressed)(void);             /* debounced; true while pressed */
    void (*drive)(int32_t permille, bool vent); /* -1000 full vacuum .. 1000 full pressure; vent opens the valve */
    size_t (*transmit_room)(void);           /* bytes that `transmit` would take now; 0 while no host listens */
    void (*transmit)(const uint8_t *data, size_t n);
} boat_hardware;

typedef struct {
    boat_state state;
    bool estop;
    bool pressure_invalid;
    bool regulated;                 /* else the valve is open and the pumps stand */
    int32_t pressure_pa;            /* last one read */
    int32_t min_pa;                 /* limits now, inside the hard ones */
    int32_t max_pa;
    int32_t target_pa;
    int32_t setpoint;               /* the setpoint moves; in Pa / 100, what 1 Pa/s makes in a tick */
    uint32_t ramp_pa_per_s;
    uint32_t timeout_us;            /* of the watchdog; 0 = not armed */
    uint64_t fed_us;
    uint64_t deadline_us;
} boat_control;

void boat_control_boot(boat_control *control, const boat_config *config);

/* Read pressure and e-stop. Returns the event of an e-stop that changed, or BOAT_NOTHING. */
boat_event_code boat_control_look(boat_control *control, const boat_hardware *hardware);

/* One tick, after a look. Returns what made the board vent, with its value, or BOAT_NOTHING. */
boat_event_code boat_control_tick(boat_control *control, uint64_t now_us, int32_t *value);

/* Set pumps and valve. */
void boat_control_drive(const boat_control *control, const boat_config *config, const boat_hardware *hardware);

/* The flags of a SAMPLE that are the control's. */
uint8_t boat_control_flags(const boat_control *control);

void boat_control_vent(boat_control *control);
boat_status boat_control_set_pressure(boat_control *control, const boat_config *config, uint64_t now_us,
                                      int32_t target_pa, uint32_t ramp_pa_per_s);
boat_status boat_control_heartbeat(boat_control *control, uint32_t timeout_ms);
boat_status boat_control_clear_fault(boat_control *control);
boat_status boat_control_set_limits(boat_control *control, const boat_config *config, int32_t min_pa, int32_t max_pa);

#endif
