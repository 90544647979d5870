"""The training loop, what it starts from, and what happens on the way. Which training runs is decided in
`recon.decide`."""
