#include "server/lab/wide_saddles.h"

#include <cmath>

namespace palpate::lab {
namespace {

using Wide = __float128;

Wide SquareRoot(Wide x) {
  Wide root = std::sqrt(static_cast<double>(x));
  // Newton's method: each step doubles the number of correct digits.
  for (int step = 0; step < 2 && root > 0; ++step) root = (root + x / root) / 2;
  return root;
}

bool IsWithin(Wide x) { return x > 0 && x < 1; }

// A derivative has no zero if its values on the four edges along its axis have the same sign. Then
// F has no critical point.
bool IsMonotone(const CellDensities& d) {
  constexpr int kEdges[3][4][2] = {{{0, 3}, {4, 7}, {1, 2}, {5, 6}},
                                   {{0, 4}, {3, 7}, {1, 5}, {2, 6}},
                                   {{0, 1}, {3, 2}, {4, 5}, {7, 6}}};
  for (const auto& axis : kEdges) {
    int rising = 0, falling = 0;
    for (const auto& [from, to] : axis) {
      rising += d[to] > d[from];
      falling += d[to] < d[from];
    }
    if (rising == 4 || falling == 4) return true;
  }
  return false;
}

// Coefficients of F, as in Trilinear.
struct WideTrilinear {
  Wide alpha, beta, gamma, delta, epsilon, eta, nu, rho;

  explicit WideTrilinear(const CellDensities& density) {
    std::array<Wide, 8> d;
    for (int v = 0; v < 8; ++v) d[v] = density[v];
    alpha = d[0];
    beta = d[3] - d[0];
    gamma = d[4] - d[0];
    delta = d[1] - d[0];
    epsilon = d[7] - d[4] - beta;
    eta = d[2] - d[1] - beta;
    nu = d[5] - d[4] - delta;
    rho = d[6] - d[5] - (d[7] - d[4]) - eta;
  }
};

}  // namespace

BodyCriticals FindBodyCriticals(const CellDensities& d, double isovalue) {
  BodyCriticals found;
  if (IsMonotone(d)) return found;
  const WideTrilinear f(d);
  // Eliminating y and z from ∇F = 0 leaves a quadratic in x: a2 x² + 2 a1 x + a0.
  const Wide b = f.beta * f.rho - f.epsilon * f.eta;
  const Wide a2 = f.rho * b;
  const Wide a1 = f.nu * b;
  const Wide a0 = f.nu * f.nu * f.beta + f.gamma * f.delta * f.rho -
                  f.nu * (f.gamma * f.eta + f.delta * f.epsilon);
  const Wide discriminant = a1 * a1 - a2 * a0;
  if (discriminant < 0) return found;
  const Wide root = SquareRoot(discriminant);
  const Wide q = a1 < 0 ? root - a1 : -(a1 + root);
  for (const Wide x : {q / a2, a0 / q}) {
    const Wide yz = f.nu + f.rho * x;
    const Wide y = -(f.delta + f.eta * x) / yz;
    const Wide z = -(f.gamma + f.epsilon * x) / yz;
    if (!IsWithin(x) || !IsWithin(y) || !IsWithin(z)) continue;
    const Wide value = f.alpha + f.beta * x + f.gamma * y + f.delta * z + f.epsilon * x * y +
                       f.eta * x * z + f.nu * y * z + f.rho * x * y * z;
    const Wide half_determinant = (f.epsilon + f.rho * z) * (f.eta + f.rho * y) * yz;
    found.point[found.count++] = {value > isovalue, half_determinant > 0};
  }
  return found;
}

FaceCritical FindFaceCritical(const std::array<double, 4>& face,
                              const std::array<double, 4>& behind,
                              const std::array<double, 4>& front, double isovalue) {
  FaceCritical found;
  const auto& [p, q, s, t] = face;
  const bool up = p > q && p > t && s > q && s > t;
  const bool down = p < q && p < t && s < q && s < t;
  if (!up && !down) return found;
  found.exists = true;
  const Wide tau = isovalue;
  const Wide product = (p - tau) * (s - tau) - (q - tau) * (t - tau);
  found.above = up ? product > 0 : product < 0;
  // Bilinear weights of the corners at the saddle, times the square of p + s - q - t.
  const Wide pq = Wide(p) - q, pt = Wide(p) - t, sq = Wide(s) - q, st = Wide(s) - t;
  const Wide weight[4] = {sq * st, pt * st, pt * pq, sq * pq};
  for (int side = 0; side < 2; ++side) {
    Wide slope = 0;
    for (int n = 0; n < 4; ++n) slope += weight[n] * (Wide((side ? front : behind)[n]) - face[n]);
    found.rises[side] = slope > 0;
  }
  return found;
}

}  // namespace palpate::lab
