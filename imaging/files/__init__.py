"""Files of every format that is read or written, and how they get to the disk whole.

A reader gives arrays and metadata; what they mean for a session is said in `imaging.session`."""
