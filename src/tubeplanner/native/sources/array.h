// A growing array without the C++ run time.
#pragma once

#include <cstdlib>
#include <cstring>

#include "numerics.h"

template <typename T>
class Array {
 public:
  Array() = default;
  Array(const Array&) = delete;
  Array& operator=(const Array&) = delete;
  ~Array() { std::free(data_); }

  T& operator[](integer i) { return data_[i]; }
  const T& operator[](integer i) const { return data_[i]; }
  T* at(integer i) { return data_ + i; }
  const T* at(integer i) const { return data_ + i; }
  integer size() const { return size_; }

  // What is added is zero.
  void resize(integer size) {
    if (size > capacity_) {
      capacity_ = size > 2 * capacity_ ? size : 2 * capacity_;
      data_ = static_cast<T*>(std::realloc(data_, capacity_ * sizeof(T)));
      if (data_ == nullptr) std::abort();
    }
    if (size > size_) std::memset(static_cast<void*>(data_ + size_), 0, (size - size_) * sizeof(T));
    size_ = size;
  }

  void clear() {
    if (size_ > 0) std::memset(static_cast<void*>(data_), 0, size_ * sizeof(T));
  }

  // The other's values become the first ones.
  void begin_with(const Array& other) {
    if (other.size_ > size_) resize(other.size_);
    if (other.size_ > 0) std::memcpy(static_cast<void*>(data_), other.data_, other.size_ * sizeof(T));
  }

  void copy(const Array& other) {
    resize(other.size_);
    begin_with(other);
  }

  void push(const T& value) {
    resize(size_ + 1);
    data_[size_ - 1] = value;
  }

 private:
  T* data_ = nullptr;
  integer size_ = 0, capacity_ = 0;
};
