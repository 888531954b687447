"""The lock on sockets between machines: CURVE, with one key pair for all that may take part.

Who has the key may speak, nobody else; and nobody else can read what is published.
"""

from __future__ import annotations

from pathlib import Path

import zmq.auth
from zmq.auth.thread import ThreadAuthenticator


class CurveAuthenticator:
    """Gives the sockets of a context the key, and lets nobody in without it.

    Raises ValueError if the file holds no key that could be used.
    """

    def __init__(
        self,
        # The context; sockets that were made before are not locked
        context: zmq.Context[zmq.Socket[bytes]],
        key: str,  # File of the secret key
    ) -> None:
        public, secret = read_key(Path(key))
        self._public = public
        self._guard = ThreadAuthenticator(context)
        self._guard.start()
        self._guard.configure_curve_callback("*", self)
        context.setsockopt(zmq.CURVE_PUBLICKEY, public)
        context.setsockopt(zmq.CURVE_SECRETKEY, secret)
        context.setsockopt(zmq.CURVE_SERVERKEY, public)

    def callback(self, domain: str, key: bytes) -> bool:
        """Whether a public key, in Z85, is let in."""
        return key == self._public

    def close(self) -> None:
        """Let nobody in any more."""
        self._guard.stop()


def make_key(path: Path) -> None:
    """Make a key file that only this user can read.

    Raises FileExistsError if there is one already: those who have it would be locked out; OSError
    if it cannot be written.
    """
    if path.exists():
        raise FileExistsError(f"key {path} exists already; it is not overwritten")
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    public, secret = zmq.curve_keypair()
    path.touch(mode=0o600)
    path.write_text(
        f'curve\n    public-key = "{public.decode()}"\n    secret-key = "{secret.decode()}"\n'
    )


def read_key(path: Path) -> tuple[bytes, bytes]:
    """Public and secret key of a file.

    Raises ValueError if it cannot be read or holds no key pair, or others may read it.
    """
    try:
        shared = path.stat().st_mode & 0o077
        public, secret = zmq.auth.load_certificate(path)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise ValueError(f"key {path} cannot be used: {why}") from None
    if secret is None or not _is_pair(public, secret):
        raise ValueError(f"key {path} cannot be used: it holds no key pair")
    if shared:
        raise ValueError(f"key {path} can be read by others; run chmod 600 {path}")
    return public, secret


def _is_pair(public: bytes, secret: bytes) -> bool:
    try:
        return bool(zmq.curve_public(secret) == public)
    except (ValueError, zmq.ZMQError):
        return False
