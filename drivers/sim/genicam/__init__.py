"""Simulated machine vision cameras above their transport: features, triggers, frames, wires and clocks."""
