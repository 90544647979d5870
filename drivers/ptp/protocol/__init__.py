"""PTP itself: containers, data sets, transactions and sessions."""
