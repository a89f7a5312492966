/* A computer in place of the microcontroller: clock, sensors, pumps and transmit buffer as plain variables. */
#ifndef HOST_H
#define HOST_H

#include "boat.h"

#define HOST_TX_MAX (1u << 20)

typedef struct {
    uint64_t clock_us; /* the firmware sees its low half */
    int32_t pressure_pa;
    bool pressure_valid, estop;
    uint8_t saturated;         /* bit n: sensor n is at full scale */
    uint32_t drop_samples;     /* so many SAMPLEs find no space */
    size_t room;               /* of the transmit buffer */
    size_t n_out;
    uint8_t out[HOST_TX_MAX];  /* what was transmitted and not yet taken */
    int32_t permille;          /* the last drive */
    bool vent;
    double kpa, flow;          /* the plant's: pressure, and the pumps' flow that lags behind their drive */
    double leak_per_s, reach_kpa;
} host_state;

extern host_state host;
extern const boat_hardware host_hardware;
extern boat_config host_config;

void host_reset(void);

/* Let the plant move on for `seconds` under the last drive. */
void host_plant(double seconds);

#endif
