"""Devices and processes that a training runs on."""
