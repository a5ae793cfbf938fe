// What the text of a user's shader says about itself, without compiling it.
#pragma once

#include <set>
#include <string>
#include <vector>

namespace encore {

class GlslSource {
 public:
  explicit GlslSource(const std::string& source);

  // The identifier occurs outside of comments, so that the shader may read or write what is named so. Where the text
  // can reach members without their names (it makes whole structs, or pastes tokens), everything is mentioned.
  bool mentions(const std::string& identifier) const { return everything_ || identifiers_.count(identifier) != 0; }
  // Names that it defines as macros, which must not reach the code that follows.
  const std::vector<std::string>& macros() const { return macros_; }

 private:
  std::set<std::string> identifiers_;
  std::vector<std::string> macros_;
  bool everything_ = false;
};

// Whether a name can be a GLSL variable of the user's; keywords are left to the compiler.
bool isGlslIdentifier(const std::string& name);

}  // namespace encore
