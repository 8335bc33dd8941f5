#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The largest RTPS message sent by UDP over loopback until it is told to stop (SIGINT, SIGTERM). Needs root.

Usage: largest_datagram.py. Prints bytes of UDP payload, and of how many messages it is the largest.
"""
import signal
import socket
import sys

largest = count = 0


def stop(*_):
    print(largest, count)
    sys.exit(0)


signal.signal(signal.SIGINT, stop)
signal.signal(signal.SIGTERM, stop)
# 0x0800: IPv4. On loopback each packet is seen twice, going out and coming in.
wire = socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(0x0800))
wire.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 64 << 20)
wire.bind(("lo", 0))
while True:
    packet, (_, _, kind, *_) = wire.recvfrom(65535)
    head = 4 * (packet[0] & 15)
    if kind == socket.PACKET_OUTGOING or packet[9] != socket.IPPROTO_UDP or packet[head + 8:head + 12] != b"RTPS":
        continue
    count += 1
    largest = max(largest, int.from_bytes(packet[head + 4:head + 6], "big") - 8)
