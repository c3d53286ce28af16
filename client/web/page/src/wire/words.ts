// Written by proto/generate/update.py from palpate/v1/*.proto: change those.
// What is said of each enumerator, by its word, in the order of its number.
export const kForceState = {
  unknown: "forces unknown",
  off: "forces off",
  "ramp-in": "forces are coming on",
  on: "forces on",
  held: "forces held back",
  fault: "forces off after a fault",
  stopped: "forces stopped",
};
export const kForceReason = {
  unknown: "",
  none: "",
  operator: "not enabled",
  docked: "the stylus rests in its holder",
  uncalibrated: "the stylus's position is not known yet",
  stale: "readings of the device are late",
  deadlines: "the haptic loop misses ticks",
  device: "the device is gone or broken",
  position: "the device gave a position or orientation that is none",
  force: "a force or torque came out that is no number",
  speed: "the stylus moved or turned faster than a hand",
  "stop-call": "emergency stop",
  "stop-button": "emergency stop by the stylus's buttons",
  replay: "until the replay ends",
};
export const kProxyMode = {
  unknown: "",
  free: "in free space",
  constrained: "held by the surface",
  ejecting: "the surface moved over the tip, the proxy is being moved out",
  fault: "nothing is felt after a fault",
  suspended: "nothing is felt: the volume is moved",
  inside: "nothing is felt: the stylus is inside the surface, pull it out",
};
