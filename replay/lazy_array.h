// A fixed-size array whose pages the operating system commits when they are first
// written, so that a buffer of 7 GB costs nothing before it fills.
#pragma once

#include <sys/mman.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <system_error>
#include <type_traits>
#include <utility>

namespace cale {

/// `size` values of T, all zero. Throws std::system_error when the address space is refused.
template <class T>
class LazyArray {
    static_assert(std::is_trivially_copyable_v<T>);

  public:
    LazyArray() = default;
    explicit LazyArray(std::int64_t size) : bytes_(static_cast<std::size_t>(size) * sizeof(T)) {
        if (bytes_ == 0) return;
        void* memory = ::mmap(nullptr, bytes_, PROT_READ | PROT_WRITE,
                              MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
        if (memory == MAP_FAILED) throw std::system_error(errno, std::generic_category(), "mmap");
        data_ = static_cast<T*>(memory);
    }
    ~LazyArray() {
        if (data_ != nullptr) ::munmap(data_, bytes_);
    }
    LazyArray(LazyArray&& other) noexcept
        : data_(std::exchange(other.data_, nullptr)), bytes_(std::exchange(other.bytes_, 0)) {}
    LazyArray& operator=(LazyArray&& other) noexcept {
        std::swap(data_, other.data_);
        std::swap(bytes_, other.bytes_);
        return *this;
    }

    T* data() { return data_; }
    const T* data() const { return data_; }
    T& operator[](std::int64_t i) { return data_[i]; }
    const T& operator[](std::int64_t i) const { return data_[i]; }

  private:
    T* data_ = nullptr;
    std::size_t bytes_ = 0;
};

}  // namespace cale
