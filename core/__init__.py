"""What palpate knows: arrays in, arrays out; no clock, file, socket, log or global state."""
