"""PTP/IP (CIPA DC-005): still cameras on Wi-Fi or Ethernet, over two TCP connections each."""
