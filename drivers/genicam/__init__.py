"""Machine vision cameras above their transport: the features of GenICam, and a camera driven by them."""
