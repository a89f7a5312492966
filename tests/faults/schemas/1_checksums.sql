-- user_version 1, as commit f9790d0 laid it out
CREATE TABLE session (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;

-- bytes as they came (direction 0) and as they were sent (direction 1)
CREATE TABLE chunk (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, direction INTEGER NOT NULL, raw BLOB NOT NULL,
    crc32 INTEGER NOT NULL);

-- a stretch of unbroken board time: a new one at START, after a reset, a reconnection, a pause; decoder is what the
-- link remembered of the bytes before first_chunk (JSON), where a link began to be recorded, else null
CREATE TABLE segment (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, first_chunk INTEGER NOT NULL, reason TEXT NOT NULL,
    paused INTEGER NOT NULL DEFAULT 0, decoder TEXT);

-- samples of one commit: little-endian records of session.sample_dtype; crc32 is theirs, null where none was kept
CREATE TABLE block (
    id INTEGER PRIMARY KEY, segment INTEGER NOT NULL, last_chunk INTEGER NOT NULL, n INTEGER NOT NULL,
    first_time_us INTEGER NOT NULL, last_time_us INTEGER NOT NULL, samples BLOB NOT NULL, crc32 INTEGER);

-- extremes of about 1,000 consecutive samples, so that a day is seen in a second
CREATE TABLE overview (
    id INTEGER PRIMARY KEY, segment INTEGER NOT NULL, first_block INTEGER NOT NULL, last_block INTEGER NOT NULL,
    n INTEGER NOT NULL, first_time_us INTEGER NOT NULL, last_time_us INTEGER NOT NULL,
    pressure_min_kpa REAL, pressure_max_kpa REAL, signal_min_mv TEXT, signal_max_mv TEXT, flags INTEGER NOT NULL);

-- what happened: source is board, host, user or sequencer; value in the unit that kind's name ends in
CREATE TABLE event (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, segment INTEGER, time_us INTEGER, source TEXT NOT NULL,
    kind TEXT NOT NULL, value REAL, text TEXT NOT NULL DEFAULT '');

-- cumulative counters of the link, one row a second
CREATE TABLE health (
    id INTEGER PRIMARY KEY, host_ns INTEGER NOT NULL, segment INTEGER, time_us INTEGER, bytes INTEGER NOT NULL,
    frames INTEGER NOT NULL, samples INTEGER NOT NULL, lost INTEGER NOT NULL, crc_errors INTEGER NOT NULL,
    malformed INTEGER NOT NULL, oversize INTEGER NOT NULL, duplicates INTEGER NOT NULL, unknown INTEGER NOT NULL,
    rate_hz REAL, lag_ms REAL);

-- the sequencer's own marks: one row a step, in board time; status is running, reached, timeout or aborted
CREATE TABLE step (
    id INTEGER PRIMARY KEY, segment INTEGER NOT NULL, number INTEGER NOT NULL, cycle INTEGER NOT NULL,
    branch TEXT NOT NULL, target_kpa REAL NOT NULL, ramp_kpa_per_s REAL NOT NULL, started_us INTEGER NOT NULL,
    arrived_us INTEGER, settled_us INTEGER, ended_us INTEGER, status TEXT NOT NULL, detail TEXT NOT NULL DEFAULT '{}');

-- readings of elongation, never changed: a correction is a newer row for the same step, the last one counts
CREATE TABLE reading (
    id INTEGER PRIMARY KEY, utc TEXT NOT NULL, step INTEGER NOT NULL, elongation_mm REAL, resolution_mm REAL,
    source TEXT NOT NULL, reader TEXT NOT NULL DEFAULT '', note TEXT NOT NULL DEFAULT '');

-- results of analyses; content and parameters are JSON
CREATE TABLE result (
    id INTEGER PRIMARY KEY, utc TEXT NOT NULL, kind TEXT NOT NULL, program_version TEXT NOT NULL, seed INTEGER,
    parameters TEXT NOT NULL, content TEXT NOT NULL);
