// Vectors of floats that begin with a cache line.
#pragma once

#include <cstddef>
#include <new>
#include <vector>

namespace cale::lite {

/// Memory that begins with a cache line: the longest vectors do not straddle two.
template <class T>
struct CacheLineAllocator {
    using value_type = T;                         // what std::allocator_traits asks for
    static constexpr std::align_val_t kLine{64};  // bytes of a cache line

    CacheLineAllocator() = default;
    /// An allocator of another type, which is as good as this one.
    template <class U>
    CacheLineAllocator(const CacheLineAllocator<U>&) {}

    /// Returns memory for so many elements. Throws std::bad_alloc.
    T* allocate(std::size_t count) { return static_cast<T*>(::operator new(count * sizeof(T), kLine)); }
    /// Frees what allocate() returned.
    void deallocate(T* memory, std::size_t) { ::operator delete(memory, kLine); }
    bool operator==(const CacheLineAllocator&) const { return true; }  // each frees what another allocated
};

/// A vector of floats in such memory.
using Floats = std::vector<float, CacheLineAllocator<float>>;

}  // namespace cale::lite
