// Sort of `keys` in shared memory by buckets: a counting sort by time, or by pixel where all times are equal, then
// ranks within each bucket. Takes as many steps as there are keys if they are spread about evenly. Needs
// event_order.glsl.

// On average a bucket of full shared memory has two events.
const uint BUCKETS = SORTABLE_EVENTS / 2u;
const uint THREAD_BUCKETS = BUCKETS / gl_WorkGroupSize.x;

// Ranking takes as many steps as a bucket has events: with more than this, a bitonic sort takes fewer. And the software
// driver ends the loops of a thread after 65535 rounds in all.
const uint RANKED_BUCKET_EVENTS = 32u;

// Smallest and largest time, and pixel with polarity, of all keys.
shared uvec2 lowest;
shared uvec2 highest;

// Events of each bucket, then where the next one has its events; sums over the buckets of threads; the largest bucket.
shared uint bucket_ends[BUCKETS];
shared uint thread_sums[gl_WorkGroupSize.x];
shared uint largest_bucket;

// Numbers of keys: bucket by bucket, and in order.
shared uint16_t by_bucket[SORTABLE_EVENTS];
shared uint16_t in_order[SORTABLE_EVENTS];

// Bucket of a key. Rises with the key, whatever the rounding.
uint bucket_of(uvec2 key, bool by_time, float buckets_per_step) {
    const uint step = by_time ? key.x - lowest.x : key.y - lowest.y;
    return min(uint(float(step) * buckets_per_step), BUCKETS - 1u);
}

// Makes each bucket's count the sum of it and all before it.
void sum_buckets() {
    const uint lane = gl_LocalInvocationID.x;
    const uint first = lane * THREAD_BUCKETS;
    uint sum = 0u;
    uint largest = 0u;
    for (uint b = first; b < first + THREAD_BUCKETS; ++b) {
        largest = max(largest, bucket_ends[b]);
        sum += bucket_ends[b];
    }
    atomicMax(largest_bucket, largest);
    thread_sums[lane] = sum;
    barrier();
    for (uint apart = 1u; apart < gl_WorkGroupSize.x; apart *= 2u) {
        const uint before_own = lane >= apart ? thread_sums[lane - apart] : 0u;
        barrier();
        thread_sums[lane] += before_own;
        barrier();
    }
    uint end = thread_sums[lane] - sum;
    for (uint b = first; b < first + THREAD_BUCKETS; ++b) {
        end += bucket_ends[b];
        bucket_ends[b] = end;
    }
    barrier();
}

// Puts the numbers of keys [0, length) into `in_order`; false if some bucket is too large, and nothing is done. Called
// by the whole workgroup after a barrier; ends with a barrier.
bool split_sort(uint length) {
    const uint lane = gl_LocalInvocationID.x;
    if (lane == 0u) {
        lowest = uvec2(0xffffffffu);
        highest = uvec2(0u);
        largest_bucket = 0u;
    }
    for (uint b = lane; b < BUCKETS; b += gl_WorkGroupSize.x) {
        bucket_ends[b] = 0u;
    }
    barrier();
    uvec2 low = uvec2(0xffffffffu);
    uvec2 high = uvec2(0u);
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        low = min(low, keys[e]);
        high = max(high, keys[e]);
    }
    low = subgroupMin(low);
    high = subgroupMax(high);
    if (subgroupElect()) {
        atomicMin(lowest.x, low.x);
        atomicMin(lowest.y, low.y);
        atomicMax(highest.x, high.x);
        atomicMax(highest.y, high.y);
    }
    barrier();
    const uvec2 range = highest - lowest;
    const bool by_time = range.x != 0u;
    const float buckets_per_step = float(BUCKETS) / (float(by_time ? range.x : range.y) + 1.0);
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        atomicAdd(bucket_ends[bucket_of(keys[e], by_time, buckets_per_step)], 1u);
    }
    barrier();
    sum_buckets();
    if (largest_bucket > RANKED_BUCKET_EVENTS) {
        return false;
    }
    // From its end on, each bucket takes its events; then the end is where it begins.
    for (uint e = lane; e < length; e += gl_WorkGroupSize.x) {
        const uint bucket = bucket_of(keys[e], by_time, buckets_per_step);
        by_bucket[atomicAdd(bucket_ends[bucket], 0xffffffffu) - 1u] = uint16_t(e);
    }
    barrier();
    for (uint i = lane; i < length; i += gl_WorkGroupSize.x) {
        const uint e = uint(by_bucket[i]);
        const uvec2 key = keys[e];
        const uint bucket = bucket_of(key, by_time, buckets_per_step);
        const uint first = bucket_ends[bucket];
        const uint end = bucket + 1u < BUCKETS ? bucket_ends[bucket + 1u] : length;
        uint rank = 0u;
        for (uint j = first; j < end; ++j) {
            const uint other = uint(by_bucket[j]);
            rank += uint(before(keys[other], key) || (keys[other] == key && other < e));
        }
        in_order[first + rank] = uint16_t(e);
    }
    barrier();
    return true;
}
