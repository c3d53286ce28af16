// Marks for what the surface hides: outlines and dashes, as in a technical drawing. Where nothing
// hides them, they are not drawn.
//
// Frame: D (mm). Threads: pure.
#pragma once

#include <span>

#include "client/view/scene/overlay.h"
#include "client/view/scene/solids.h"

namespace palpate::view {

inline constexpr std::uint8_t kGhostLine = 235;  // alpha of outlines and dashes
inline constexpr std::uint8_t kGhostBody = 45;   // alpha of the body within

// Closes the outline from its last corner to its first.
void AddGhostOutline(std::span<const Vec3> corners_D, const std::array<std::uint8_t, 4>& rgba,
                     Overlay& overlay);

// A corner on each dash's begin and end. A line of more than 400 dashes gets longer ones.
void AddGhostDashes(const Vec3& from_D, const Vec3& to_D, double dash_mm,
                    const std::array<std::uint8_t, 4>& rgba, Overlay& overlay);

// The two edges of a turned body (AddTurned) as it is seen from `eye_D`. Dark dashes take turns
// with light ones, so that they are visible on any surface. None if the eye is on the axis.
void AddGhostEdges(const Vec3& origin_D, const Vec3& axis, std::span<const Ring> rings,
                   const Vec3& eye_D, double dash_mm, Overlay& overlay);

}  // namespace palpate::view
