"""A vendor-class USB interface with one bulk endpoint in each direction, through pyusb."""

from __future__ import annotations

import contextlib
import errno
from typing import Any

import usb.core
import usb.util

from drivers.transports._addresses import usb_ids
from drivers.transports._base import Transport

_CHUNK = 65536
_WRITE_TIMEOUT_MS = 1000


class UsbTransport(Transport):
    """The first interface of the device ``usb:VID:PID`` (hexadecimal), claimed for this process."""

    def __init__(self, address: str, backend: Any = None) -> None:
        super().__init__(address)
        vendor, product = usb_ids(address)
        try:
            device = usb.core.find(idVendor=vendor, idProduct=product, backend=backend)
        except usb.core.NoBackendError as error:
            raise self._lost(f"no USB library on this machine ({error})") from error
        except usb.core.USBError as error:
            raise self._lost(error) from error
        if device is None:
            raise self._lost("no such device is plugged in")
        self._device: Any = device
        try:
            device.set_configuration()
            interface = device.get_active_configuration()[(0, 0)]
            usb.util.claim_interface(device, interface)
            self._in = self._bulk(interface, usb.util.ENDPOINT_IN)
            self._out = self._bulk(interface, usb.util.ENDPOINT_OUT)
        except usb.core.USBError as error:
            self.close()
            raise self._lost(error) from error

    def _bulk(self, interface: Any, direction: int) -> Any:
        """The interface's bulk endpoint in one direction."""
        found = usb.util.find_descriptor(
            interface,
            custom_match=lambda e: (
                usb.util.endpoint_direction(e.bEndpointAddress) == direction
                and usb.util.endpoint_type(e.bmAttributes) == usb.util.ENDPOINT_TYPE_BULK
            ),
        )
        if found is None:
            self.close()
            way = "in" if direction == usb.util.ENDPOINT_IN else "out"
            raise self._lost(f"the device has no bulk endpoint ({way})")
        return found

    def _receive(self, timeout: float) -> bytes:
        try:
            # A time-out of 0 means "for ever" to libusb; 1 ms is its shortest.
            return bytes(self._in.read(_CHUNK, max(1, round(timeout * 1000))))
        except usb.core.USBTimeoutError:
            return b""
        except usb.core.USBError as error:
            if error.errno == errno.EOVERFLOW:
                return b""
            raise self._lost(error) from error

    def write(self, data: bytes) -> None:
        try:
            sent = 0
            while sent < len(data):
                sent += self._out.write(data[sent:], _WRITE_TIMEOUT_MS)
        except usb.core.USBError as error:
            raise self._lost(error) from error

    def close(self) -> None:
        with contextlib.suppress(usb.core.USBError, OSError):
            usb.util.dispose_resources(self._device)
        self._release()
