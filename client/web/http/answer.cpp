#include "client/web/http/answer.h"

#include <algorithm>

namespace palpate::web {
namespace {

namespace http = boost::beast::http;

std::string_view Trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

// True for ";q=0" and ";q=0.000".
bool IsRefused(std::string_view parameters) {
  const std::size_t q = parameters.find("q=");
  return q != std::string_view::npos &&
         Trimmed(parameters.substr(q + 2)).find_first_not_of("0.") == std::string_view::npos;
}

}  // namespace

Answer TextAnswer(http::status status, std::string line) {
  Answer answer;
  answer.status = status;
  answer.body = std::make_shared<const std::string>(std::move(line) + "\n");
  answer.fields = {{http::field::cache_control, "no-store"}};
  return answer;
}

void AddProtection(http::fields& fields) {
  fields.set("Content-Security-Policy",
             "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
             "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
  fields.set("X-Content-Type-Options", "nosniff");
  fields.set("Referrer-Policy", "no-referrer");
  fields.set("Cross-Origin-Resource-Policy", "same-origin");
  fields.set("Cross-Origin-Opener-Policy", "same-origin");
}

Encoding ChooseEncoding(std::string_view accept) {
  Encoding best = Encoding::kIdentity;
  while (!accept.empty()) {
    const std::size_t comma = std::min(accept.find(','), accept.size());
    const std::string_view item = accept.substr(0, comma);
    accept.remove_prefix(std::min(comma + 1, accept.size()));
    const std::size_t semicolon = std::min(item.find(';'), item.size());
    const std::string_view name = Trimmed(item.substr(0, semicolon));
    if (IsRefused(item.substr(semicolon))) continue;
    if (name == "zstd") return Encoding::kZstd;
    if (name == "gzip") best = Encoding::kGzip;
  }
  return best;
}

bool HeldBodies::Hold(const Body& body, const Holder& holder) {
  if (!body) return true;
  if (!all_.holders.contains(body.get()) && body->size() > Left(holder)) return false;
  for (Bodies* bodies : {&all_, &networks_[holder.network], &users_[holder.user]}) {
    if (++bodies->holders[body.get()] == 1) bodies->bytes += body->size();
  }
  return true;
}

void HeldBodies::Release(const Body& body, const Holder& holder) {
  if (!body) return;
  for (Bodies* bodies : {&all_, &networks_[holder.network], &users_[holder.user]}) {
    if (--bodies->holders[body.get()] > 0) continue;
    bodies->holders.erase(body.get());
    bodies->bytes -= body->size();
  }
  if (networks_[holder.network].holders.empty()) networks_.erase(holder.network);
  if (users_[holder.user].holders.empty()) users_.erase(holder.user);
}

std::size_t HeldBodies::Left(const Holder& holder) const {
  std::size_t used = all_.bytes;
  if (const auto held = networks_.find(holder.network); held != networks_.end()) {
    used += held->second.bytes;
  }
  if (const auto held = users_.find(holder.user); held != users_.end()) used += held->second.bytes;
  return std::max(kSmallBytes, most_bytes_ - std::min(used, most_bytes_));
}

}  // namespace palpate::web
