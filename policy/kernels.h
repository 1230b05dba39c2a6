// The inner loops of a network, compiled once for every instruction set.
#pragma once

#include <cstddef>

namespace cale::lite {

/// How a sum is written.
enum class Store {
    plain,  // as it is
    relu,   // 0 where it is negative
    add,    // added to what is there
};

/// A convolution. Images lie in memory row by row, the channels of a pixel side by side, and are surrounded
/// by as many zeros as the kernel reaches beyond them: a row of the kernel covers kernel_width neighbouring
/// floats. Weights are ordered [channels / block][kernel_rows][kernel_width][block].
struct Convolution {
    std::size_t kernel_rows = 0;
    std::size_t kernel_width = 0;  // kernel columns x input channels
    std::size_t input_row = 0;     // floats from one row of the input to the next
    std::size_t row_stride = 0;    // floats between the inputs of neighbouring output rows
    std::size_t pixel_stride = 0;  // floats between the inputs of neighbouring output pixels
    std::size_t rows = 0, columns = 0, channels = 0;  // of the output
    std::size_t output_row = 0;
    std::size_t block = 0;  // channels that are computed together: one or two vectors
    Store store = Store::plain;
};

/// A dense layer on the vectors of several observations, which share each pass over the weights. A vector's
/// result does not depend on how many there are.
struct DenseShape {
    std::size_t outputs = 0, inputs = 0;
    std::size_t vectors = 1;      // of observations
    std::size_t next_vector = 0;  // floats from one observation's input to the next one's, and so of outputs
};

/// The loops for one instruction set.
struct Kernels {
    const char* name;
    std::size_t vector;  // floats that are computed in one instruction
    void (*convolve)(const Convolution& shape, const float* input, const float* weights, const float* bias,
                     float* output);
    /// output = weights [outputs, inputs] x input + bias
    void (*dense)(const DenseShape& shape, const float* input, const float* weights, const float* bias,
                  float* output);
};

/// Returns the fastest kernels that this machine can run.
const Kernels& kernels();

extern const Kernels kPortableKernels, kAvx2Kernels, kAvx512Kernels;

}  // namespace cale::lite
