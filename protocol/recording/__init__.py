"""The recording: its schema, checks of untrusted files, files of readings. Its imports are the interface."""

from protocol.recording.channels import CHANNELS_MAX, RESERVED, ExtraChannel, channels_of, session_channels
from protocol.recording.metadata import METADATA_EVENT, Metadata, metadata_of
from protocol.recording.schema import (
    ADDED,
    APPLICATION_ID,
    BRANCHES,
    CAMERA_TABLE,
    MARK_EVENT,
    NOT_FOR_FIGURES,
    NOTE_EVENT,
    SCHEMA_VERSION,
    SESSION_KEYS,
    SUFFIX,
    TABLE_NAMES,
    TABLES,
    VIDEO_TABLE,
    BoardState,
    RunEnd,
    SampleFlag,
    SampleKind,
    breaks_of,
    check_long_tables,
    describe_dtype,
    dtype_from_description,
    fitted,
    layout_version,
    note_of,
    open_recording,
    overview_extremes,
    read_session,
    refuse_newer,
    run_end_of,
    sample_dtype,
    session_dtype,
)
from protocol.recording.segments import SEGMENT_KINDS, Segment
