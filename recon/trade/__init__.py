"""Costs and gains of settings: trainings of one session with one thing changed at a time."""

from recon.trade.point import front
from recon.trade.records import Choice, Point, Trade, read_trade
from recon.trade.sweep import trade_sweep

__all__ = ["Choice", "Point", "Trade", "front", "read_trade", "trade_sweep"]
