"""Single decisions of a training, one file each; `decide` in `recon/decide/decisions.py` orders them."""
