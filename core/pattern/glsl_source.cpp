#include "core/pattern/glsl_source.h"

#include <algorithm>
#include <cctype>

namespace encore {
namespace {

bool startsName(char c) { return std::isalpha(static_cast<unsigned char>(c)) || c == '_'; }
bool continuesName(char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; }

// The text with line continuations joined and comments replaced by blanks.
std::string withoutComments(const std::string& source) {
  std::string joined;
  for (size_t i = 0; i < source.size(); ++i) {
    if (source[i] == '\\' && i + 1 < source.size() && source[i + 1] == '\n')
      ++i;
    else if (source[i] == '\\' && source.compare(i + 1, 2, "\r\n") == 0)
      i += 2;
    else
      joined += source[i];
  }
  std::string text;
  for (size_t i = 0; i < joined.size();) {
    if (joined.compare(i, 2, "//") == 0) {
      i = std::min(joined.find('\n', i), joined.size());
    } else if (joined.compare(i, 2, "/*") == 0) {
      const size_t end = joined.find("*/", i + 2);
      i = end == std::string::npos ? joined.size() : end + 2;
      text += ' ';
    } else {
      text += joined[i++];
    }
  }
  return text;
}

std::string nameAt(const std::string& text, size_t begin) {
  size_t end = begin;
  while (end < text.size() && continuesName(text[end])) ++end;
  return text.substr(begin, end - begin);
}

size_t skipBlanks(const std::string& text, size_t at) {
  while (at < text.size() && std::isspace(static_cast<unsigned char>(text[at])) && text[at] != '\n') ++at;
  return at;
}

// Structs of shaders/pattern/surface.glsl and displacement.glsl.
bool isContractStruct(const std::string& name) {
  return name == "Surface" || name == "SurfacePoint" || name == "DisplacementPoint";
}

}  // namespace

GlslSource::GlslSource(const std::string& source) {
  const std::string text = withoutComments(source);
  everything_ = text.find("##") != std::string::npos;
  bool directive = false, line_start = true;
  for (size_t i = 0; i < text.size();) {
    const char c = text[i];
    if (c == '\n') {
      directive = false, line_start = true;
      ++i;
    } else if (c == '#' && line_start) {
      directive = true;
      const size_t word = skipBlanks(text, i + 1);
      const std::string command = nameAt(text, word);
      if (command == "include") everything_ = true;
      if (command == "define") macros_.push_back(nameAt(text, skipBlanks(text, word + command.size())));
      i = word + command.size();
    } else if (startsName(c)) {
      const std::string name = nameAt(text, i);
      i += name.size();
      identifiers_.insert(name);
      // Surface(…) and macros of it set members that the text does not name.
      if (isContractStruct(name)) {
        const size_t next = text.find_first_not_of(" \t\r\n", i);
        everything_ = everything_ || directive || (next != std::string::npos && !startsName(text[next]));
      }
      line_start = false;
    } else if (continuesName(c)) {  // a number, with its suffix
      while (i < text.size() && continuesName(text[i])) ++i;
      line_start = false;
    } else {
      line_start = line_start && std::isspace(static_cast<unsigned char>(c));
      ++i;
    }
  }
}

bool isGlslIdentifier(const std::string& name) {
  if (name.empty() || !startsName(name[0]) || name.size() > 256) return false;
  for (char c : name)
    if (!continuesName(c)) return false;
  return name.rfind("gl_", 0) != 0 && name.find("__") == std::string::npos;
}

}  // namespace encore
