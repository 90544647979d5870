"""Costs and gains of settings: trainings of one session with one thing changed at a time."""

from recon.trade.point import front
from recon.trade.sweep import trade_sweep
from recon.trade.trade_record import Choice, Point, Trade, read_trade

__all__ = ["Choice", "Point", "Trade", "front", "read_trade", "trade_sweep"]
