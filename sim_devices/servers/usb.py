"""A virtual USB host controller for pyusb: the driver's pyusb calls are the real ones, only the wires are not.

Bulk transfers to and from the device travel over a loopback TCP connection to the simulated instrument, so that the
same device can live in this process or in another one.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
from array import array
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import usb.backend
import usb.core
import usb.util

from drivers.transports import GREETING

ENDPOINT_IN, ENDPOINT_OUT = 0x81, 0x01
_PACKET = 512
_STRINGS = {1: "skinrig", 2: "virtual micro-robot controller", 3: "SIM-M1"}


@dataclass(frozen=True)
class VirtualDevice:
    """A device on the virtual bus: its ids, and the TCP port of the loopback interface that is its cable,
    with the token it wants."""

    vendor: int
    product: int
    port: int
    token: str = ""


class _Handle:
    """An opened device. The cable is connected when the interface is claimed."""

    def __init__(self, device: VirtualDevice) -> None:
        self.device = device
        self.cable: socket.socket | None = None

    def need_cable(self) -> socket.socket:
        if self.cable is None:
            raise usb.core.USBError("No such device (it may have been disconnected)", None, errno.ENODEV)
        return self.cable

    def unplug(self) -> None:
        if self.cable is not None:
            self.cable.close()
            self.cable = None


class VirtualUsb(usb.backend.IBackend):  # type: ignore[misc]  # pyusb has no types
    """A backend whose bus carries the given devices; each has one vendor interface with two bulk endpoints."""

    def __init__(self, *devices: VirtualDevice) -> None:
        self.devices = devices
        self._handles: list[_Handle] = []

    def enumerate_devices(self) -> Any:
        yield from self.devices

    def get_device_descriptor(self, dev: VirtualDevice) -> Any:
        return SimpleNamespace(
            bLength=18,
            bDescriptorType=usb.util.DESC_TYPE_DEVICE,
            bcdUSB=0x0200,
            bDeviceClass=0xFF,
            bDeviceSubClass=0,
            bDeviceProtocol=0,
            bMaxPacketSize0=64,
            idVendor=dev.vendor,
            idProduct=dev.product,
            bcdDevice=0x0100,
            iManufacturer=1,
            iProduct=2,
            iSerialNumber=3,
            bNumConfigurations=1,
            address=self.devices.index(dev) + 1,
            bus=1,
            port_number=self.devices.index(dev) + 1,
            port_numbers=(self.devices.index(dev) + 1,),
            speed=usb.util.SPEED_HIGH,
        )

    def get_configuration_descriptor(self, dev: VirtualDevice, config: int) -> Any:
        if config:
            raise IndexError("the device has one configuration")
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=usb.util.DESC_TYPE_CONFIG,
            wTotalLength=32,
            bNumInterfaces=1,
            bConfigurationValue=1,
            iConfiguration=0,
            bmAttributes=0x80,
            bMaxPower=250,
            extra_descriptors=[],
        )

    def get_interface_descriptor(self, dev: VirtualDevice, intf: int, alt: int, config: int) -> Any:
        if intf or alt or config:
            raise IndexError("the device has one interface without alternates")
        return SimpleNamespace(
            bLength=9,
            bDescriptorType=usb.util.DESC_TYPE_INTERFACE,
            bInterfaceNumber=0,
            bAlternateSetting=0,
            bNumEndpoints=2,
            bInterfaceClass=0xFF,
            bInterfaceSubClass=0,
            bInterfaceProtocol=0,
            iInterface=0,
            extra_descriptors=[],
        )

    def get_endpoint_descriptor(self, dev: VirtualDevice, ep: int, intf: int, alt: int, config: int) -> Any:
        return SimpleNamespace(
            bLength=7,
            bDescriptorType=usb.util.DESC_TYPE_ENDPOINT,
            bEndpointAddress=(ENDPOINT_IN, ENDPOINT_OUT)[ep],
            bmAttributes=usb.util.ENDPOINT_TYPE_BULK,
            wMaxPacketSize=_PACKET,
            bInterval=0,
            bRefresh=0,
            bSynchAddress=0,
            extra_descriptors=[],
        )

    def open_device(self, dev: VirtualDevice) -> _Handle:
        handle = _Handle(dev)
        self._handles.append(handle)
        return handle

    def close_device(self, dev_handle: _Handle) -> None:
        dev_handle.unplug()
        self._handles.remove(dev_handle)

    def set_configuration(self, dev_handle: _Handle, config_value: int) -> None:
        """The only configuration is always set."""

    def get_configuration(self, dev_handle: _Handle) -> int:
        return 1

    def claim_interface(self, dev_handle: _Handle, intf: int) -> None:
        if any(h is not dev_handle and h.cable for h in self._handles if h.device == dev_handle.device):
            raise usb.core.USBError("Resource busy", None, errno.EBUSY)
        if dev_handle.cable is None:
            try:
                dev_handle.cable = socket.create_connection(("127.0.0.1", dev_handle.device.port), timeout=1.0)
                if dev_handle.device.token:
                    dev_handle.cable.sendall(GREETING.format(dev_handle.device.token).encode())
            except OSError:
                dev_handle.need_cable()

    def release_interface(self, dev_handle: _Handle, intf: int) -> None:
        dev_handle.unplug()

    def is_kernel_driver_active(self, dev_handle: _Handle, intf: int) -> bool:
        return False

    def bulk_write(self, dev_handle: _Handle, ep: int, intf: int, data: Any, timeout: int) -> int:
        cable = dev_handle.need_cable()
        cable.settimeout(timeout / 1000 or None)
        try:
            cable.sendall(data)
        except TimeoutError:
            raise usb.core.USBTimeoutError("Operation timed out", None, errno.ETIMEDOUT) from None
        except OSError:
            dev_handle.unplug()
            dev_handle.need_cable()
        return len(data)

    def bulk_read(self, dev_handle: _Handle, ep: int, intf: int, buff: array[int], timeout: int) -> int:
        cable = dev_handle.need_cable()
        if not select.select([cable], [], [], timeout / 1000 or None)[0]:
            raise usb.core.USBTimeoutError("Operation timed out", None, errno.ETIMEDOUT)
        count = 0
        with contextlib.suppress(OSError):
            count = cable.recv_into(memoryview(buff).cast("B"))
        if not count:
            dev_handle.unplug()
            dev_handle.need_cable()
        return count
