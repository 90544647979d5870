"""A virtual USB bus as a pyusb backend, its devices, and a time that passes only when all wait."""
