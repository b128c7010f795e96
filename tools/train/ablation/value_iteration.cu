// Value iteration forward and backward on a GPU: one block per map, 196 of its 224 threads own four cells of a row.
//
// CHANNELS is defined by whoever compiles this. Maps are 28 x 28; planes in shared memory have a border of zeros.
#define SIDE 28
#define CELLS 784
#define STRIDE 32
#define PLANE (30 * STRIDE + 8)
#define THREADS 224
#define OWNERS 196

// reward [B, CHANNELS, 784], kernels [CHANNELS, 9] to values [B, rounds, 784] and winners [B, rounds, 784].
extern "C" __global__ void __launch_bounds__(THREADS)
forward(const float* reward, const float* kernels, float* values, unsigned char* winners, int rounds)
{
    __shared__ float weight[CHANNELS * 9];
    __shared__ float plane[2][PLANE];
    const int map = blockIdx.x, thread = threadIdx.x;
    for (int i = thread; i < CHANNELS * 9; i += THREADS) weight[i] = kernels[i];
    for (int i = thread; i < 2 * PLANE; i += THREADS) (&plane[0][0])[i] = 0.f;
    const bool owns = thread < OWNERS;
    const int row = thread / 7, col = thread % 7 * 4;
    float start[CHANNELS][4];
    if (owns) {
        #pragma unroll
        for (int q = 0; q < CHANNELS; q++) {
            float4 four = *(const float4*)(reward + ((size_t)map * CHANNELS + q) * CELLS + row * SIDE + col);
            start[q][0] = four.x; start[q][1] = four.y; start[q][2] = four.z; start[q][3] = four.w;
        }
    }
    __syncthreads();
    int from = 0;
    for (int round = 0; round < rounds; round++) {
        if (owns) {
            float near[3][6];
            #pragma unroll
            for (int i = 0; i < 3; i++)
                #pragma unroll
                for (int j = 0; j < 6; j++) near[i][j] = plane[from][(row + i) * STRIDE + col + j];
            float best[4];
            int winner[4];
            #pragma unroll
            for (int q = 0; q < CHANNELS; q++) {
                float sum[4] = {start[q][0], start[q][1], start[q][2], start[q][3]};
                #pragma unroll
                for (int tap = 0; tap < 9; tap++) {
                    float w = weight[q * 9 + tap];
                    #pragma unroll
                    for (int j = 0; j < 4; j++) sum[j] = fmaf(w, near[tap / 3][j + tap % 3], sum[j]);
                }
                #pragma unroll
                for (int j = 0; j < 4; j++)
                    if (q == 0 || sum[j] > best[j]) { best[j] = sum[j]; winner[j] = q; }
            }
            float* own = &plane[from ^ 1][(row + 1) * STRIDE + col + 1];
            #pragma unroll
            for (int j = 0; j < 4; j++) own[j] = best[j];
            size_t place = ((size_t)map * rounds + round) * CELLS + row * SIDE + col;
            *(float4*)(values + place) = make_float4(best[0], best[1], best[2], best[3]);
            *(uchar4*)(winners + place) = make_uchar4(winner[0], winner[1], winner[2], winner[3]);
        }
        from ^= 1;
        __syncthreads();
    }
}

// Gradient of the last values [B, 784] to that of the reward [B, CHANNELS, 784] and, per map, of the kernels.
extern "C" __global__ void __launch_bounds__(THREADS)
backward(const float* slope, const float* kernels, const float* values, const unsigned char* winners,
         float* reward_slope, float* kernel_slope, int rounds)
{
    __shared__ float weight[CHANNELS * 9], total[CHANNELS * 9];
    __shared__ float sent[PLANE], before[PLANE];
    __shared__ int won[PLANE];
    const int map = blockIdx.x, thread = threadIdx.x;
    for (int i = thread; i < CHANNELS * 9; i += THREADS) { weight[i] = kernels[i]; total[i] = 0.f; }
    for (int i = thread; i < PLANE; i += THREADS) { sent[i] = 0.f; before[i] = 0.f; won[i] = 0; }
    const bool owns = thread < OWNERS;
    const int row = thread / 7, col = thread % 7 * 4, own = (row + 1) * STRIDE + col + 1;
    float sums[CHANNELS][9], rewards[CHANNELS][4];
    #pragma unroll
    for (int q = 0; q < CHANNELS; q++) {
        #pragma unroll
        for (int i = 0; i < 9; i++) sums[q][i] = 0.f;
        #pragma unroll
        for (int i = 0; i < 4; i++) rewards[q][i] = 0.f;
    }
    __syncthreads();
    float g[4] = {0, 0, 0, 0};
    if (owns) {
        float4 four = *(const float4*)(slope + (size_t)map * CELLS + row * SIDE + col);
        g[0] = four.x; g[1] = four.y; g[2] = four.z; g[3] = four.w;
    }
    for (int round = rounds - 1; round >= 0; round--) {
        int winner[4] = {0, 0, 0, 0};
        if (owns) {
            size_t place = ((size_t)map * rounds + round) * CELLS + row * SIDE + col;
            uchar4 four = *(const uchar4*)(winners + place);
            winner[0] = four.x; winner[1] = four.y; winner[2] = four.z; winner[3] = four.w;
            float4 v = make_float4(0, 0, 0, 0);
            if (round > 0) v = *(const float4*)(values + place - CELLS);
            before[own] = v.x; before[own + 1] = v.y; before[own + 2] = v.z; before[own + 3] = v.w;
            #pragma unroll
            for (int j = 0; j < 4; j++) { won[own + j] = winner[j]; sent[own + j] = g[j]; }
        }
        __syncthreads();
        if (owns) {
            float near[3][6];
            #pragma unroll
            for (int i = 0; i < 3; i++)
                #pragma unroll
                for (int j = 0; j < 6; j++) near[i][j] = before[(row + i) * STRIDE + col + j];
            #pragma unroll
            for (int q = 0; q < CHANNELS; q++)
                #pragma unroll
                for (int j = 0; j < 4; j++) {
                    float mine = winner[j] == q ? g[j] : 0.f;
                    rewards[q][j] += mine;
                    #pragma unroll
                    for (int tap = 0; tap < 9; tap++)
                        sums[q][tap] = fmaf(mine, near[tap / 3][j + tap % 3], sums[q][tap]);
                }
            // A cell was read by its neighbour in the direction opposite to the tap.
            float next[4] = {0, 0, 0, 0};
            #pragma unroll
            for (int tap = 0; tap < 9; tap++) {
                const int off = -((tap / 3 - 1) * STRIDE + tap % 3 - 1);
                #pragma unroll
                for (int j = 0; j < 4; j++)
                    next[j] = fmaf(weight[won[own + j + off] * 9 + tap], sent[own + j + off], next[j]);
            }
            #pragma unroll
            for (int j = 0; j < 4; j++) g[j] = next[j];
        }
        __syncthreads();
    }
    if (owns) {
        #pragma unroll
        for (int q = 0; q < CHANNELS; q++)
            *(float4*)(reward_slope + ((size_t)map * CHANNELS + q) * CELLS + row * SIDE + col) =
                make_float4(rewards[q][0], rewards[q][1], rewards[q][2], rewards[q][3]);
    }
    #pragma unroll
    for (int q = 0; q < CHANNELS; q++)
        #pragma unroll
        for (int i = 0; i < 9; i++) {
            float x = sums[q][i];
            for (int lane = 16; lane > 0; lane >>= 1) x += __shfl_down_sync(0xffffffffu, x, lane);
            if ((thread & 31) == 0) atomicAdd(&total[q * 9 + i], x);
        }
    __syncthreads();
    for (int i = thread; i < CHANNELS * 9; i += THREADS) kernel_slope[(size_t)map * CHANNELS * 9 + i] = total[i];
}
