"""What is published (`types`), how it is packed (`codec`, `fields`).

How it travels (`bus`) and how it is kept (`recording`). To be touched: the field types in `fields`,
of which anybody makes message types of their own; the limits of a body are in `codec`, and changing
one changes what is refused. Rests on numpy and msgspec; knows nothing of `palpate.core`.
"""

from palpate.rooms import TYPE_CHECKING, lazy

if TYPE_CHECKING:
    from palpate.messages.codec import HEADER_SIZE as HEADER_SIZE, Header as Header
    from palpate.messages.codec import codec_of as codec_of, decode as decode, derive as derive
    from palpate.messages.codec import encode as encode, first_difference as first_difference
    from palpate.messages.codec import pack_frame as pack_frame, schema as schema
    from palpate.messages.codec import schema_hash as schema_hash, shortened as shortened
    from palpate.messages.codec import split_frame as split_frame
    from palpate.messages.described import type_of_schema as type_of_schema
    from palpate.messages.fields import Array as Array, CodecError as CodecError, Count as Count
    from palpate.messages.fields import PerMetre as PerMetre, Seconds as Seconds, Vector as Vector
else:
    __getattr__, __dir__ = lazy(__name__)
