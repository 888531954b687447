"""Messages: their types (`types`), encoding (`codec`, `fields`), transport and recording.

Transport is in `bus`, recording in `recording`. Users define their own message types with the field
types in `fields`. The limits of a body are in `codec` and `fields`; changing them changes which
messages are refused. This package uses numpy and msgspec, and nothing of `palpate.core`.
"""

from palpate.messages.codec import (
    HEADER_SIZE as HEADER_SIZE,
    Header as Header,
    codec_of as codec_of,
    decode as decode,
    encode as encode,
    first_difference as first_difference,
    pack_frame as pack_frame,
    schema as schema,
    schema_hash as schema_hash,
    shortened as shortened,
    split_frame as split_frame,
)
from palpate.messages.described import type_of_schema as type_of_schema
from palpate.messages.fields import (
    Array as Array,
    CodecError as CodecError,
    Count as Count,
    PerMetre as PerMetre,
    Seconds as Seconds,
    Vector as Vector,
)
