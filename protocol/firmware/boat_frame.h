/* Framing of the BOAT link (SPEC.md, "Carrier and framing"): CRC-32, COBS, and the receiver that finds good frames.

   Rules: a frame ends at a 00 and nowhere else, damage is counted and never an error, every buffer has a fixed size and
   belongs to the caller. */
#ifndef BOAT_FRAME_H
#define BOAT_FRAME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BOAT_BODY_MIN 6u
#define BOAT_BODY_MAX 200u
#define BOAT_COLLECT_MAX 210u
#define BOAT_SEAL_ROOM 6u /* bytes of a frame beside type, seq and payload: COBS code, CRC, closing 00 */

typedef struct {
    uint8_t data[BOAT_COLLECT_MAX];
    uint8_t collected;
    bool skipping; /* in an oversize run, until its 00 */
    uint32_t frames;
    uint32_t crc_errors;
    uint32_t malformed;
    uint32_t oversize;
} boat_receiver;

uint32_t boat_crc32(const uint8_t *data, size_t n);

/* Turn frame[1] .. frame[n] = type, seq, payload into the bytes on the wire; `frame` has room for n + BOAT_SEAL_ROOM,
   n is at most 196. Returns how many bytes to send. */
size_t boat_seal(uint8_t *frame, size_t n);

/* Take one byte. Returns the length of type, seq and payload when it ends a good frame, whose bytes are then at
   `*body` until the next call; else 0. */
size_t boat_take_byte(boat_receiver *receiver, uint8_t byte, const uint8_t **body);

#endif
