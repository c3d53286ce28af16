// The ray of this pixel. It begins where it enters what the cuts leave: coordinates near the volume
// keep their digits however far away the eye is.
vec3 origin;
vec3 direction;  // of length 1; tiny components are set to exactly 0
float reach;  // length of the ray within what the cuts leave
bool at_cut;  // the ray enters through the crop box or a plane, not from outside
bool begins_outside;  // the ray enters through the volume's border, where F is the background
bool ends_outside;  // the ray ends at the volume's border, not at a cut

// A ray that does not move along an axis never reaches a plane across that axis.
const float kNever = 1e30;

// Narrows `entry` and `leave` to the distances of the faces through which the ray passes, and sets
// `entry_axis` and `leave_axis` to their axes. Returns false if the ray misses the box.
bool MeetBox(inout float entry, inout float leave, inout int entry_axis, inout int leave_axis) {
  for (int a = 0; a < 3; ++a) {
    if (direction[a] == 0.0) {
      if (eye[a] < crop_min[a] || eye[a] > crop_max[a]) return false;
      continue;
    }
    float near = ((direction[a] > 0.0 ? crop_min[a] : crop_max[a]) - eye[a]) / direction[a];
    float far = ((direction[a] > 0.0 ? crop_max[a] : crop_min[a]) - eye[a]) / direction[a];
    if (far < leave) {
      leave = far;
      leave_axis = a;
    }
    if (near > entry) {
      entry = near;
      entry_axis = a;
    }
  }
  return entry < leave;
}

bool IsCut(int axis, bool upper) {
  return upper ? crop_max[axis] < float(cells[axis]) : crop_min[axis] > 0.0;
}

// The same for the planes. The results say whether the ray enters and leaves through them.
bool MeetPlanes(inout float entry, inout float leave, out bool enters, out bool leaves) {
  enters = false;
  leaves = false;
  for (int n = 0; n < 2; ++n) {
    float rate = dot(planes[n].xyz, direction);
    float room = planes[n].w - dot(planes[n].xyz, eye);
    if (abs(rate) < 1e-9) {
      if (room < 0.0) return false;
    } else if (rate > 0.0 && room / rate < leave) {
      leave = room / rate;
      leaves = true;
    } else if (rate < 0.0 && room / rate > entry) {
      entry = room / rate;
      enters = true;
    }
  }
  return entry < leave;
}

// Returns false if the cuts leave nothing of the ray.
bool FindRay() {
  vec3 d = normalize(direction_from_pixel * vec3(gl_FragCoord.xy - image_center.xy, 1.0));
  direction = mix(d, vec3(0.0), lessThan(abs(d), vec3(1e-9)));
  float entry = 0.0;
  float leave = kNever;
  int in_axis = -1;
  int out_axis = -1;
  bool into_plane, out_of_plane;
  if (!MeetBox(entry, leave, in_axis, out_axis)) return false;
  if (!MeetPlanes(entry, leave, into_plane, out_of_plane)) return false;

  origin = clamp(eye + entry * direction, vec3(0.0), vec3(cells));
  reach = leave - entry;
  at_cut = into_plane;
  if (!into_plane && in_axis >= 0) {
    origin[in_axis] = direction[in_axis] > 0.0 ? crop_min[in_axis] : crop_max[in_axis];
    at_cut = IsCut(in_axis, direction[in_axis] < 0.0);
  }
  begins_outside = !into_plane && in_axis >= 0 && !at_cut;
  ends_outside = !out_of_plane && !IsCut(out_axis, direction[out_axis] > 0.0);
  return true;
}

// Distances of the planes through which the ray leaves the cells low .. high - 1. A plane has the
// same distance for every cell and brick.
vec3 LeaveOf(ivec3 low, ivec3 high) {
  vec3 planes_ahead = mix(vec3(low), vec3(high), greaterThan(direction, vec3(0.0)));
  return mix((planes_ahead - origin) / direction, vec3(kNever), equal(direction, vec3(0.0)));
}

int FirstAxis(vec3 leave) {
  return leave.x <= leave.y ? (leave.x <= leave.z ? 0 : 2) : (leave.y <= leave.z ? 1 : 2);
}
