"""Someone who looks at the page, without a browser: takes everything that it sends, frames and
scene alike.
"""

from __future__ import annotations

import asyncio
import contextlib
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

if TYPE_CHECKING:
    from websockets import Subprotocol

WINDOW = "realtime-check"


def look(url: str) -> None:
    """Visit the page at `url` until the server is gone, or the process is ended. The target of a
    spawned process.
    """
    asyncio.run(_look(url))


async def _look(url: str) -> None:
    import viser  # seconds; its version is what its websocket asks for
    from websockets import Subprotocol

    address = urlsplit(url)
    base = f"ws://{address.netloc}"
    await asyncio.gather(
        _take(f"{base}/session?{address.query}&window={WINDOW}", None),
        _take(f"{base}/scene/{WINDOW}", [Subprotocol(f"viser-v{viser.__version__}")]),
    )


async def _take(address: str, protocols: list[Subprotocol] | None) -> None:
    from websockets.asyncio.client import connect
    from websockets.exceptions import ConnectionClosed

    with contextlib.suppress(ConnectionClosed):
        async with connect(address, subprotocols=protocols, max_size=None) as connection:
            async for _ in connection:
                pass
