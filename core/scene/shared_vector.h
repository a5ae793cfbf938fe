// A vector whose copies share their elements until one of them is written to: what is known of a mesh can be kept
// from frame to frame, and be a part of many scenes, without being there twice.
#pragma once

#include <cstddef>
#include <initializer_list>
#include <memory>
#include <utility>
#include <vector>

namespace encore {

// Reading is a vector's; writing, through whatever is not const, first makes the elements this copy's own. Copies
// may be read and destroyed by several threads at once, one copy written to by one of them.
template <class T>
class SharedVector {
 public:
  using value_type = T;
  using Vector = std::vector<T>;
  using const_iterator = typename Vector::const_iterator;
  using iterator = typename Vector::iterator;

  SharedVector() = default;
  SharedVector(Vector values) : values_(values.empty() ? nullptr : std::make_shared<Vector>(std::move(values))) {}
  SharedVector(std::initializer_list<T> values) : SharedVector(Vector(values)) {}

  operator const Vector&() const { return get(); }
  const Vector& get() const {
    static const Vector none;
    return values_ ? *values_ : none;
  }
  Vector& edit() {
    if (!values_)
      values_ = std::make_shared<Vector>();
    else if (values_.use_count() > 1)
      values_ = std::make_shared<Vector>(*values_);
    return *values_;
  }
  // Whether both are copies of one another: nothing was written to either of them since.
  bool shares(const SharedVector& other) const { return values_ == other.values_; }

  size_t size() const { return values_ ? values_->size() : 0; }
  size_t capacity() const { return values_ ? values_->capacity() : 0; }
  bool empty() const { return size() == 0; }
  const T* data() const { return get().data(); }
  const T& operator[](size_t i) const { return (*values_)[i]; }
  const T& at(size_t i) const { return get().at(i); }
  const T& front() const { return get().front(); }
  const T& back() const { return get().back(); }
  const_iterator begin() const { return get().begin(); }
  const_iterator end() const { return get().end(); }

  T* data() { return edit().data(); }
  T& operator[](size_t i) { return edit()[i]; }
  T& at(size_t i) { return edit().at(i); }
  T& front() { return edit().front(); }
  T& back() { return edit().back(); }
  iterator begin() { return edit().begin(); }
  iterator end() { return edit().end(); }
  void push_back(T value) { edit().push_back(std::move(value)); }
  void pop_back() { edit().pop_back(); }
  template <class... Arguments>
  T& emplace_back(Arguments&&... arguments) {
    return edit().emplace_back(std::forward<Arguments>(arguments)...);
  }
  void resize(size_t size, const T& value = {}) { edit().resize(size, value); }
  void reserve(size_t size) { edit().reserve(size); }
  void clear() { values_.reset(); }
  template <class... Arguments>
  void assign(Arguments&&... arguments) {
    edit().assign(std::forward<Arguments>(arguments)...);
  }
  template <class... Arguments>
  iterator insert(Arguments&&... arguments) {
    return edit().insert(std::forward<Arguments>(arguments)...);
  }

  friend bool operator==(const SharedVector& a, const SharedVector& b) { return a.shares(b) || a.get() == b.get(); }

 private:
  std::shared_ptr<Vector> values_;
};

}  // namespace encore
