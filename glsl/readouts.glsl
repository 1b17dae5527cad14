// The table of readouts, by the `slot` of their cameras.
layout(set = 0, binding = SLOT_READOUTS, std140) uniform Buffer_readouts { Readout readouts[MAX_CAMERAS]; };
