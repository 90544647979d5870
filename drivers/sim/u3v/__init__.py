"""Simulated machine vision cameras: registers, GenICam description, acquisition and the stream."""
