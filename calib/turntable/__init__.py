"""Things on a turntable before cameras that stand still: the room masked, and turns as they are stated."""
