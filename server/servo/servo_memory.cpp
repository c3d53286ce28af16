#include "server/servo/servo_memory.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <type_traits>

#include "common/contract/enumerations.h"

namespace palpate {
namespace {

// Version of the byte layout. Raise it whenever the meaning of the bytes changes.
constexpr std::uint8_t kLayout = 8;
constexpr std::uint8_t kLayoutWithoutTools = 7;  // 6 knew no torque
// It knew no layers: after a pop, densities changed their sign. A refinement other than 1 follows
// the rest.
constexpr std::uint8_t kLayoutWithoutLayers = 5;

constexpr int kMaxCell = 1 << 30;

// Visits every number. The structured bindings name all members: a new member does not compile
// until it is visited.
template <class Vector, class Visit>
void VisitVector(Vector&& vector, Visit& visit) {
  for (auto& number : vector.reshaped()) visit(number);
}

template <class CarrierT, class Visit>
void VisitCarrier(CarrierT& carrier, Visit& visit) {
  auto& [count, vertex, weight] = carrier;
  visit(count);
  for (auto& v : vertex) visit(v);
  for (auto& w : weight) visit(w);
}

template <class PlaceT, class Visit>
void VisitPlace(PlaceT& place, Visit& visit) {
  auto& [kind, cell, faces, p_L, carrier, tetrahedron] = place;
  visit(kind);
  VisitVector(cell, visit);
  visit(faces);
  VisitVector(p_L, visit);
  VisitCarrier(carrier, visit);
  visit(tetrahedron);
}

template <class ProxyT, class Visit>
void VisitProxy(ProxyT& proxy, int layout, Visit& visit) {
  auto& [placed, contact, buried, place, p_DH_mm, geometry_revision, refinement, volume_revision,
         loaded_revision, free_side, isovalue, lower] = proxy;
  visit(placed);
  visit(contact);
  visit(buried);
  VisitPlace(place, visit);
  VisitVector(p_DH_mm, visit);
  visit(geometry_revision);
  visit(volume_revision);
  visit(loaded_revision);
  visit(free_side);
  visit(isovalue);
  if (layout == kLayoutWithoutLayers) return;
  visit(lower);
  visit(refinement);
}

template <class Passivity, class Visit>
void VisitPassivity(Passivity& passivity, Visit& visit) {
  auto& [started, tank_mj, damping, distrust, scale, written_D_n, p_DHip_mm, time_s, positions,
         newest, rest_mm, rested_s] = passivity;
  visit(started);
  for (auto* number : {&tank_mj, &damping, &distrust, &scale}) visit(*number);
  VisitVector(written_D_n, visit);
  for (auto& p : p_DHip_mm) VisitVector(p, visit);
  for (auto& time : time_s) visit(time);
  visit(positions);
  visit(newest);
  VisitVector(rest_mm, visit);
  visit(rested_s);
}

// Without a tool it is not there.
template <class Tool, class Visit>
void VisitTool(Tool& tool, Visit& visit) {
  auto& [state, felt, is_settling, touches, slope_per_mm, R_DS, turned_mm, spring_mj, tank,
         passivity] = tool;
  auto& [placed, buried, pose, stalled_steps, ejecting_steps, ejected_mm, loaded_revision] = state;
  visit(placed);
  if (!placed) return;
  visit(buried);
  VisitVector(pose.p_DS_mm, visit);
  VisitVector(pose.R_DS.coeffs(), visit);
  for (auto* steps : {&stalled_steps, &ejecting_steps}) visit(*steps);
  visit(ejected_mm);
  visit(loaded_revision);
  auto& [geometry_revision, volume_revision, refinement, free_side, isovalue, stiffness] = felt;
  for (auto* revision : {&geometry_revision, &volume_revision}) visit(*revision);
  visit(refinement);
  visit(free_side);
  for (auto* number : {&isovalue, &stiffness}) visit(*number);
  visit(is_settling);
  visit(touches);
  for (auto* number : {&slope_per_mm, &spring_mj}) visit(*number);
  VisitVector(R_DS.coeffs(), visit);
  VisitVector(turned_mm, visit);
  auto& [tank_mj, written_D, moved_D, last_mj] = tank;
  for (auto* number : {&tank_mj, &last_mj}) visit(*number);
  for (auto* v : {&written_D, &moved_D}) VisitVector(*v, visit);
  VisitPassivity(passivity, visit);
}

template <class Renderer, class Visit>
void VisitRenderer(Renderer& renderer, int layout, Visit& visit) {
  auto& [proxy, has_hip, p_DHip_mm, p_DLastHip_mm, velocity_mm_per_s, friction, passed, rejected_s,
         spring_mj, felt_D_n, pop_force_D_n, pop_fade, passivity, limited_D_n, by_design_D_n,
         touched, slack_mm, layered] = renderer;
  VisitProxy(proxy, layout, visit);
  visit(has_hip);
  for (auto* v : {&p_DHip_mm, &p_DLastHip_mm, &velocity_mm_per_s}) VisitVector(*v, visit);
  auto& [sticking, normal_D, slid_mm] = friction;
  visit(sticking);
  VisitVector(normal_D, visit);
  visit(passed);
  for (auto* number : {&rejected_s, &spring_mj, &pop_fade}) visit(*number);
  VisitPassivity(passivity, visit);
  for (auto* v : {&felt_D_n, &pop_force_D_n, &limited_D_n, &by_design_D_n}) VisitVector(*v, visit);
  if (layout == kLayoutWithoutLayers) return;
  visit(touched);
  visit(slack_mm);
  visit(slid_mm);
  visit(layered);
}

template <class SafetyT, class Visit>
void VisitSafety(SafetyT& safety, int layout, Visit& visit) {
  auto& [state, reason, last_D, ramp_s, ramp_in_s, was_suspended, resumes, heat_n2, heat_n_mm2,
         has_hip, p_DHip_mm, hip_age_s, velocity_mm_per_s, R_DS, turn_rad_per_s, missed_ticks] =
      safety;
  auto& [force_n, torque_n_mm] = last_D;
  visit(state);
  visit(reason);
  for (auto* flag : {&was_suspended, &resumes, &has_hip}) visit(*flag);
  for (auto* v : {&force_n, &p_DHip_mm, &velocity_mm_per_s}) VisitVector(*v, visit);
  for (auto* number : {&ramp_s, &ramp_in_s, &heat_n2, &hip_age_s, &missed_ticks}) visit(*number);
  if (layout < kLayoutWithoutTools) return;
  VisitVector(torque_n_mm, visit);
  VisitVector(R_DS.coeffs(), visit);
  for (auto* number : {&heat_n_mm2, &turn_rad_per_s}) visit(*number);
}

template <class Memory, class Visit>
void VisitMemory(Memory& memory, int layout, Visit visit) {
  auto& [renderer, tool, safety, tick, missed_ticks, capped_ticks, faulty_ticks] = memory;
  VisitRenderer(renderer, layout, visit);
  if (layout > kLayoutWithoutTools) VisitTool(tool, visit);
  VisitSafety(safety, layout, visit);
  for (auto* count : {&tick, &missed_ticks, &capped_ticks, &faulty_ticks}) visit(*count);
}

// The first value beyond T's valid ones.
template <class T>
constexpr std::size_t kEnd = 2;  // bool
template <>
constexpr std::size_t kEnd<Place::Kind> = 3;
template <>
constexpr std::size_t kEnd<Contact> = 3;

// Returns false if the bytes are no valid value of T.
template <class T>
bool FromBytes(const char* bytes, T& value) {
  if constexpr (Declared<T>) {
    const auto byte = static_cast<unsigned char>(*bytes);
    value = static_cast<T>(byte + 1);
    return byte < kWords<T>.size();
  } else if constexpr (std::is_same_v<T, bool> || std::is_enum_v<T>) {
    static_assert(sizeof(T) == 1);
    const auto byte = static_cast<unsigned char>(*bytes);
    value = static_cast<T>(byte);
    return byte < kEnd<T>;
  } else {
    std::memcpy(&value, bytes, sizeof value);
    return true;
  }
}

// No stylus is this far away. Squares of such lengths do not overflow.
constexpr double kFarthestMm = 1e9;
constexpr double kUnitTolerance = 1e-6;

bool IsPosition(const Vec3& p_mm) {
  return p_mm.allFinite() && p_mm.cwiseAbs().maxCoeff() <= kFarthestMm;
}

// True for positive weights of different vertices with sum 1.
bool IsCarrier(const Carrier& carrier) {
  if (carrier.count < 1 || carrier.count > 4) return false;
  double sum = 0.0;
  for (int n = 0; n < carrier.count; ++n) {
    if (!(carrier.weight[n] >= 0.0)) return false;
    sum += carrier.weight[n];
  }
  return std::abs(sum - 1.0) < kUnitTolerance && std::popcount(carrier.Mask()) == carrier.count;
}

// True if the place lies within its cell and on exactly the faces that it names.
bool IsInBox(const Place& place) {
  std::uint8_t faces = 0;
  for (int axis = 0; axis < 3; ++axis) {
    const double p = place.p_L[axis], low = place.cell[axis], high = low + 1.0;
    if (!(p >= low && p <= high)) return false;
    if (p == low) faces |= static_cast<std::uint8_t>(1u << (2 * axis));
    if (p == high) faces |= static_cast<std::uint8_t>(2u << (2 * axis));
  }
  return place.faces == faces;
}

// Fits (proxy.h) checks the vertices against the scene's cell.
bool IsPlace(const Place& place) {
  if (std::ranges::any_of(place.carrier.vertex, [](int v) { return v >= kMaxVertices; }) ||
      (place.cell.array() < -kMaxCell).any() || (place.cell.array() > kMaxCell).any()) {
    return false;
  }
  switch (place.kind) {
    case Place::Kind::kOutside:
      return place.p_L.allFinite();
    case Place::Kind::kBox:
      return IsInBox(place);
    case Place::Kind::kSimplex:
      return IsCarrier(place.carrier) && place.faces == FacesOf(place.carrier) &&
             place.tetrahedron >= -1 && place.tetrahedron < kMaxTetrahedra &&
             (place.tetrahedron < 0 || place.carrier.count == 4);
  }
  return false;
}

// Normalised isovalues lie within 0 and 1, or their negatives. The next one starts there.
constexpr double kGreatestIsovalue = 2.0;

bool IsBound(double isovalue, double unbounded) {
  return std::abs(isovalue) <= kGreatestIsovalue || isovalue == unbounded;
}

template <int kDimensions>
bool IsPassivity(const PassivityStateOf<kDimensions>& passivity) {
  constexpr int kKept = PassivityStateOf<kDimensions>::kPositionsKept;
  return passivity.positions >= 0 && passivity.positions <= kKept && passivity.newest >= 0 &&
         passivity.newest < kKept;
}

bool IsUnit(const Eigen::Vector4d& q) { return std::abs(q.norm() - 1.0) < kUnitTolerance; }

bool IsTool(const ToolMemory& tool) {
  return IsPosition(tool.state.pose.p_DS_mm) && IsUnit(tool.state.pose.R_DS.coeffs()) &&
         IsUnit(tool.R_DS.coeffs()) && IsBound(tool.felt.isovalue, kUnbounded) &&
         tool.felt.refinement >= 1 && tool.felt.refinement <= kMaxRefinement &&
         tool.slope_per_mm >= 0.0 && tool.spring_mj >= 0.0 && tool.turned_mm.allFinite() &&
         tool.state.stalled_steps >= 0 && std::isfinite(tool.state.ejected_mm) &&
         std::isfinite(tool.tank.tank_mj + tool.tank.spring_mj) &&
         tool.tank.written_D.allFinite() && tool.tank.moved_D.allFinite() &&
         IsPassivity(tool.passivity);
}

// Checks that indices stay within their arrays and lattices, and that lengths are finite.
bool IsInRange(const ServoMemory& memory) {
  const RendererMemory& renderer = memory.renderer;
  const Proxy& proxy = renderer.proxy;
  const bool on_simplex = proxy.placed && proxy.place.kind == Place::Kind::kSimplex;
  return IsPlace(proxy.place) && IsPosition(proxy.p_DH_mm) && IsBound(proxy.isovalue, kUnbounded) &&
         IsBound(proxy.lower, -kUnbounded) && proxy.refinement >= 1 &&
         proxy.refinement <= kMaxRefinement && (renderer.has_hip || !proxy.placed) &&
         (on_simplex || !proxy.on_surface()) && renderer.touched >= -kMaxLayers &&
         renderer.touched <= kMaxLayers && renderer.slack_mm >= 0.0 &&
         renderer.slack_mm <= kFarthestMm && renderer.friction.slid_mm >= 0.0 &&
         renderer.friction.slid_mm <= kFarthestMm && IsPosition(renderer.p_DHip_mm) &&
         IsPosition(renderer.p_DLastHip_mm) &&
         renderer.friction.normal_D.norm() < 1.0 + kUnitTolerance &&
         IsPassivity(renderer.passivity) && IsTool(memory.tool);
}

// Gives a proxy that has popped through the one surface its bound, with the sign of the settings'
// side. Returns false for what no servo without layers had.
bool WithBounds(RendererMemory& renderer) {
  Proxy& proxy = renderer.proxy;
  if (renderer.passed > 1 || proxy.contact == Contact::kLower) return false;
  if (renderer.passed == 0) return true;
  proxy.free_side = OtherSide(proxy.free_side);
  proxy.lower = -proxy.isovalue;
  proxy.isovalue = kUnbounded;
  if (proxy.on_surface()) proxy.contact = Contact::kLower;
  return true;
}

}  // namespace

ServoKeyframe Save(const ServoMemory& memory) noexcept {
  ServoKeyframe keyframe;
  keyframe.tick = memory.tick;
  std::size_t at = 0;
  const auto put = [&](auto number) {
    // Files number enumerators from 0.
    if constexpr (Declared<decltype(number)>) {
      number = static_cast<decltype(number)>(static_cast<int>(number) - 1);
    }
    if (at + sizeof number <= keyframe.bytes.size()) {
      std::memcpy(&keyframe.bytes[at], &number, sizeof number);
    }
    at += sizeof number;
  };
  put(kLayout);
  VisitMemory(memory, kLayout, put);
  keyframe.size = at;
  return keyframe;
}

bool Load(std::string_view bytes, ServoMemory& memory) noexcept {
  const int layout = bytes.empty() ? 0 : static_cast<unsigned char>(bytes.front());
  if (layout < kLayoutWithoutLayers || layout > kLayout) return false;
  memory = {};
  std::size_t at = 1;
  bool good = true;
  VisitMemory(memory, layout, [&](auto& number) {
    good = good && at + sizeof number <= bytes.size() && FromBytes(&bytes[at], number);
    at += sizeof number;
  });
  if (good && layout == kLayoutWithoutLayers) {
    if (at + 1 == bytes.size()) {
      memory.renderer.proxy.refinement = static_cast<unsigned char>(bytes[at++]);
    }
    good = WithBounds(memory.renderer);
  }
  return good && at == bytes.size() && IsInRange(memory);
}

}  // namespace palpate
