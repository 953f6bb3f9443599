"""The checksums of the protocols, computed here, independently of what is tested."""


def total(data):
    """The low byte of the sum: ASCII, LC-02 and 0x55."""
    return sum(data) & 0xFF


def crc(data):
    """The CRC of Modbus in the order in which it is sent: low byte first."""
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ (0xA001 if value & 1 else 0)
    return value.to_bytes(2, "little")
