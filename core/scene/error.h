// The one exception type of core: what went wrong, where, and what to do about it.
#pragma once

#include <stdexcept>
#include <string>
#include <utility>

namespace encore {

// The command line maps kinds to exit codes (docs/exit_codes.md).
enum class ErrorKind {
  Scene,    // a description that cannot be rendered; where() is a prim path
  Setting,  // a render setting out of range; where() is its name
  Device,   // no usable Vulkan device, or the device failed
  Memory,   // a budget or cap that the frame does not fit into
  Cancelled,
  Internal,
};

class Error : public std::runtime_error {
 public:
  // what: what was found. where: prim path (and attribute) or setting. remedy: what to do.
  Error(ErrorKind kind, std::string what, std::string where = {}, std::string remedy = {})
      : std::runtime_error(compose(what, where, remedy)),
        kind_(kind),
        where_(std::move(where)),
        remedy_(std::move(remedy)) {}

  ErrorKind kind() const { return kind_; }
  const std::string& where() const { return where_; }
  const std::string& remedy() const { return remedy_; }

 private:
  static std::string compose(const std::string& what, const std::string& where, const std::string& remedy) {
    return (where.empty() ? "" : where + ": ") + what + (remedy.empty() ? "" : ". " + remedy);
  }
  ErrorKind kind_;
  std::string where_, remedy_;
};

}  // namespace encore
