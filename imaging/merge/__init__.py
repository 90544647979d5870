"""Exposures as linear light, and several of one view as one: weights, ratios, ghosts, movement, masks.

One bracket at a time; the stage that merges a session is `calib.exports.merge_session`."""
