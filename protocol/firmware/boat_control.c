#include "boat_control.h"

#define MARGIN_PA 2000
#define TOLERANCE_PA 500
#define PATIENCE_US 8000000u /* beyond the ramp's own time, until a target counts as not reached */
#define PER_PA 100           /* setpoint units; BOAT_TICK_US = 1 s / PER_PA */
#define TIMEOUT_MIN_MS 100u
#define TIMEOUT_MAX_MS 5000u

static int32_t clamp(int32_t value, int32_t low, int32_t high)
{
    int32_t above = (value < low) ? low : value;

    return (above > high) ? high : above;
}

static bool moving(const boat_control *control)
{
    return (control->state == BOAT_RAMPING) || (control->state == BOAT_HOLDING);
}

/* +1 or -1 beyond a limit by more than the margin, else 0. */
static int beyond(const boat_control *control)
{
    if (control->pressure_pa > (control->max_pa + MARGIN_PA)) {
        return 1;
    }
    return (control->pressure_pa < (control->min_pa - MARGIN_PA)) ? -1 : 0;
}

static void latch(boat_control *control)
{
    control->regulated = false;
    control->state = BOAT_FAULT;
}

/* Regulate towards a target; from ambient or wherever the pressure stands. */
static void command(boat_control *control, int32_t target_pa, uint32_t ramp_pa_per_s)
{
    if (!control->regulated) {
        control->setpoint =
            PER_PA * clamp(control->pressure_pa, control->min_pa - MARGIN_PA, control->max_pa + MARGIN_PA);
    }
    control->target_pa = target_pa;
    control->ramp_pa_per_s = ramp_pa_per_s;
    control->regulated = true;
}

void boat_control_boot(boat_control *control, const boat_config *config)
{
    control->state = BOAT_IDLE;
    control->estop = false;
    control->pressure_invalid = false;
    control->regulated = false;
    control->pressure_pa = 0;
    control->target_pa = 0;
    control->setpoint = 0;
    control->min_pa = config->pressure_min_pa;
    control->max_pa = config->pressure_max_pa;
    control->ramp_pa_per_s = 0;
    control->timeout_us = 0;
    control->fed_us = 0;
    control->deadline_us = 0;
}

boat_event_code boat_control_look(boat_control *control, const boat_hardware *hardware)
{
    bool was_pressed = control->estop;

    control->estop = hardware->estop_pressed();
    control->pressure_invalid = !hardware->read_pressure(&control->pressure_pa);
    if (control->estop || control->pressure_invalid) {
        latch(control);
    }
    if (control->estop == was_pressed) {
        return BOAT_NOTHING;
    }
    return control->estop ? BOAT_ESTOP_PRESSED : BOAT_ESTOP_RELEASED;
}

/* Move the setpoint by one tick of its ramp. */
static void move_setpoint(boat_control *control)
{
    int32_t gap = (PER_PA * control->target_pa) - control->setpoint;
    int32_t most = (int32_t)control->ramp_pa_per_s;

    control->setpoint += clamp(gap, -most, most);
}

/* RAMPING or HOLDING, and whether the target is overdue. */
static bool overdue(boat_control *control, uint64_t now_us)
{
    int32_t error_pa = control->pressure_pa - control->target_pa;

    if ((control->setpoint == (PER_PA * control->target_pa)) && (error_pa <= TOLERANCE_PA) &&
        (error_pa >= -TOLERANCE_PA)) {
        control->state = BOAT_HOLDING;
        control->deadline_us = now_us + PATIENCE_US;
    } else {
        control->state = BOAT_RAMPING;
    }
    return now_us >= control->deadline_us;
}

boat_event_code boat_control_tick(boat_control *control, uint64_t now_us, int32_t *value)
{
    boat_event_code code = BOAT_NOTHING;

    if (control->state == BOAT_FAULT) {
        return BOAT_NOTHING;
    }
    *value = control->pressure_pa;
    if ((control->timeout_us != 0u) && (now_us >= (control->fed_us + control->timeout_us))) {
        uint32_t silence_us = (uint32_t)(now_us - control->fed_us);

        code = BOAT_HEARTBEAT_LOST;
        *value = (int32_t)(uint32_t)(silence_us / 1000u);
    } else if (beyond(control) != 0) {
        code = (beyond(control) > 0) ? BOAT_OVER_PRESSURE : BOAT_UNDER_PRESSURE;
    } else if (moving(control) && overdue(control, now_us)) {
        code = BOAT_TARGET_NOT_REACHED;
    } else {
        /* nothing is wrong */
    }
    if (code != BOAT_NOTHING) {
        latch(control);
    } else if (control->regulated) {
        move_setpoint(control);
    } else {
        /* the setpoint is taken from the pressure when it is regulated again */
    }
    return code;
}

/* The ramp's own drive, and more in proportion to the error: the pumps' flow integrates to pressure, so that no
   error remains. */
void boat_control_drive(const boat_control *control, const boat_config *config, const boat_hardware *hardware)
{
    int32_t permille = 0;

    if (control->regulated) {
        int32_t gap = (PER_PA * control->target_pa) - control->setpoint;
        int32_t error_pa = clamp((control->setpoint / PER_PA) - control->pressure_pa, -30000, 30000);
        int32_t correction = (error_pa * (int32_t)config->gain_permille_per_kpa) / 1000;
        uint32_t ramp = (1000u * control->ramp_pa_per_s) / config->ramp_max_pa_per_s;

        if (gap > 0) {
            permille = (int32_t)ramp;
        } else {
            permille = (gap < 0) ? -(int32_t)ramp : 0;
        }
        permille = clamp(permille + correction, -1000, 1000);
    }
    hardware->drive(permille, !control->regulated);
}

uint8_t boat_control_flags(const boat_control *control)
{
    uint32_t flags = control->estop ? BOAT_ESTOP : 0u;

    flags |= (control->timeout_us != 0u) ? BOAT_ARMED : 0u;
    flags |= control->pressure_invalid ? BOAT_PRESSURE_INVALID : 0u;
    return (uint8_t)flags;
}

void boat_control_vent(boat_control *control)
{
    control->regulated = false;
    if (control->state != BOAT_FAULT) {
        control->state = BOAT_VENTED;
    }
}

boat_status boat_control_set_pressure(boat_control *control, const boat_config *config, uint64_t now_us,
                                      int32_t target_pa, uint32_t ramp_pa_per_s)
{
    uint32_t ramp = ramp_pa_per_s;
    uint32_t travel_ms;
    int32_t travel_pa;

    if (control->state == BOAT_FAULT) {
        return BOAT_FAULT_LATCHED;
    }
    if ((target_pa < control->min_pa) || (target_pa > control->max_pa)) {
        return BOAT_OUT_OF_LIMITS;
    }
    if ((ramp == 0u) || (ramp > config->ramp_max_pa_per_s)) {
        ramp = config->ramp_max_pa_per_s;
    }
    command(control, target_pa, ramp);
    travel_pa = target_pa - clamp(control->pressure_pa, control->min_pa - MARGIN_PA, control->max_pa + MARGIN_PA);
    travel_ms = (1000u * (uint32_t)((travel_pa < 0) ? -travel_pa : travel_pa)) / ramp;
    control->deadline_us = now_us + PATIENCE_US + ((uint64_t)travel_ms * 1000u);
    control->state = BOAT_RAMPING;
    return BOAT_DONE;
}

boat_status boat_control_heartbeat(boat_control *control, uint32_t timeout_ms)
{
    if ((timeout_ms == 0u) && (control->state != BOAT_IDLE) && (control->state != BOAT_VENTED)) {
        return BOAT_NOT_IN_THIS_STATE;
    }
    if ((timeout_ms != 0u) && ((timeout_ms < TIMEOUT_MIN_MS) || (timeout_ms > TIMEOUT_MAX_MS))) {
        return BOAT_OUT_OF_LIMITS;
    }
    control->timeout_us = 1000u * timeout_ms;
    return BOAT_DONE;
}

boat_status boat_control_clear_fault(boat_control *control)
{
    if ((control->state != BOAT_FAULT) || control->estop || control->pressure_invalid || (beyond(control) != 0)) {
        return BOAT_NOT_IN_THIS_STATE;
    }
    control->state = BOAT_VENTED;
    return BOAT_DONE;
}

/* A pressure on its way beyond the new limits turns back to the nearer one. */
boat_status boat_control_set_limits(boat_control *control, const boat_config *config, int32_t min_pa, int32_t max_pa)
{
    int32_t inside_pa;

    if ((min_pa >= max_pa) || (min_pa < config->pressure_min_pa) || (max_pa > config->pressure_max_pa)) {
        return BOAT_OUT_OF_LIMITS;
    }
    control->min_pa = min_pa;
    control->max_pa = max_pa;
    inside_pa = clamp(control->target_pa, min_pa, max_pa);
    if (moving(control) && (inside_pa != control->target_pa)) {
        command(control, inside_pa, config->ramp_max_pa_per_s);
    }
    return BOAT_DONE;
}
