#include "client/web/volume/blob_shelf.h"

#include "client/web/volume/blob_name.h"

namespace palpate::web {

BlobPtr BlobShelf::Find(std::string_view name) const {
  const auto hash = ParseName(name);
  if (!hash) return nullptr;
  const std::lock_guard lock(mutex_);
  const auto found = held_.find(*hash);
  return found == held_.end() ? nullptr : found->second.blob;
}

void BlobShelf::Use(const ContentHash& hash, std::size_t bytes,
                    const std::function<BlobPtr()>& make) {
  const std::lock_guard lock(mutex_);
  Held& held = held_[hash];
  if (!held.blob) {
    held = {.blob = make(), .bytes = bytes};
  } else if (held.uses == 0) {
    superseded_bytes_ -= held.bytes;
  }
  ++held.uses;
}

void BlobShelf::Release(const ContentHash& hash, Time now) {
  const std::lock_guard lock(mutex_);
  Held& held = held_.at(hash);
  if (--held.uses > 0) return;
  held.superseded = ++releases_;
  superseded_bytes_ += held.bytes;
  superseded_.push_back({hash, held.superseded, now});
}

void BlobShelf::Drop(const ContentHash& hash) {
  const std::lock_guard lock(mutex_);
  const auto found = held_.find(hash);
  if (found == held_.end() || found->second.uses > 0) return;
  superseded_bytes_ -= found->second.bytes;
  held_.erase(found);
}

void BlobShelf::Expire(Time now) {
  const std::lock_guard lock(mutex_);
  while (!superseded_.empty() && (superseded_.front().since + kKeptFor <= now ||
                                  superseded_bytes_ > kMostSupersededBytes)) {
    const auto found = held_.find(superseded_.front().hash);
    const bool is_last = found != held_.end() && found->second.uses == 0 &&
                         found->second.superseded == superseded_.front().number;
    superseded_.pop_front();
    if (!is_last) continue;
    superseded_bytes_ -= found->second.bytes;
    held_.erase(found);
  }
}

std::size_t BlobShelf::size() const {
  const std::lock_guard lock(mutex_);
  return held_.size();
}

}  // namespace palpate::web
