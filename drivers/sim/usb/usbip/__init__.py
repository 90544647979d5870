"""The virtual bus over TCP, as Linux attaches devices of other machines: USB/IP."""
