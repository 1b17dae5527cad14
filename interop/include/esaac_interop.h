/* Messages between a producer of frames and the engine, protocol versions 1 and 2.
 *
 * One message is one packet of a Unix socket of type SOCK_SEQPACKET, in the machine's byte order, with
 * descriptors beside it (SCM_RIGHTS). README.md says who sends what when; producer.c in examples/ does it.
 *
 * Version 2 has depth, instance ids, a lens and poses. Its messages are named _2; they begin as those of version 1 and
 * go on. A producer speaks one version: that of its HELLO. Messages without a _2 are the same in both. */
#ifndef ESAAC_INTEROP_H
#define ESAAC_INTEROP_H

#include <stdint.h>

#define ESAAC_MAGIC 0x50495345u /* "ESIP" */
#define ESAAC_VERSION 1u
#define ESAAC_VERSION_2 2u
#define ESAAC_MAX_SLOTS 16u
#define ESAAC_NO_MOTION 0xffffffffu

enum esaac_kind {
    ESAAC_HELLO = 1,    /* producer */
    ESAAC_RING = 2,     /* engine, with descriptors */
    ESAAC_BROUGHT = 3,  /* producer, with descriptors */
    ESAAC_ACCEPTED = 4, /* engine; a header alone */
    ESAAC_FRAME = 5,    /* producer */
    ESAAC_RELEASED = 6, /* engine */
    ESAAC_BYE = 7,      /* producer; a header alone */
    ESAAC_ERROR = 8,    /* either; may be of version 1 whatever is spoken */
    ESAAC_POSES = 9     /* producer; version 2 */
};

enum esaac_memory {
    ESAAC_MEMORY_EXPORTED = 1,
    ESAAC_MEMORY_HOST = 2,
    ESAAC_MEMORY_BROUGHT = 4,
    ESAAC_MEMORY_IMAGES = 8
};
enum esaac_timeline { ESAAC_TIMELINE_CARRIED = 1, ESAAC_TIMELINE_EXPORTED = 2 };
enum esaac_backpressure { ESAAC_LOSSLESS = 0, ESAAC_LATEST = 1 };
enum esaac_outcome { ESAAC_STEPPED = 0, ESAAC_DROPPED = 1 };
enum esaac_hdr_format { ESAAC_HDR_F16X4 = 0, ESAAC_HDR_F32X4 = 1, ESAAC_HDR_SRGB8X4 = 2 };
enum esaac_motion_format { ESAAC_MOTION_F16X2 = 0, ESAAC_MOTION_F32X2 = 1, ESAAC_MOTION_F32X4 = 2 };

struct esaac_header {
    uint32_t magic;   /* ESAAC_MAGIC */
    uint16_t version; /* ESAAC_VERSION or ESAAC_VERSION_2, as of HELLO */
    uint16_t kind;    /* enum esaac_kind */
    uint32_t bytes;   /* of the whole message */
    uint32_t fds;     /* descriptors beside it */
};

struct esaac_image_memory {
    uint64_t bytes;            /* of each buffer, or of an image's texels, as RING says: a multiple of 16 */
    uint64_t allocation_bytes; /* of its memory, or of its file */
    uint32_t memory_type;      /* Vulkan memory type; BROUGHT may leave it open: 0xffffffff */
    uint32_t image_usage;      /* VkImageUsageFlags of an image, on both sides; 0 of a buffer */
};

struct esaac_hello {
    struct esaac_header header;
    uint8_t device_uuid[16]; /* VkPhysicalDeviceIDProperties */
    uint8_t driver_uuid[16]; /* zeroes for a device without a Vulkan driver, as CUDA's */
    uint32_t camera;
    uint32_t width_px; /* 0 for as the rig has it */
    uint32_t height_px;
    uint32_t memories;  /* bits that it can use */
    uint32_t timelines; /* bits that it can use */
    uint32_t reserved;
};

struct esaac_ring {
    struct esaac_header header;
    uint8_t device_uuid[16];
    uint8_t driver_uuid[16];
    uint32_t camera;
    uint32_t cameras; /* of the rig */
    uint32_t width_px;
    uint32_t height_px;
    uint32_t hdr_format;
    uint32_t motion_format; /* or ESAAC_NO_MOTION */
    uint32_t memory;        /* one bit */
    uint32_t timeline;      /* one bit */
    uint32_t slots;
    uint32_t backpressure;
    uint32_t buffer_usage; /* VkBufferUsageFlags of every buffer of the ring, on both sides */
    uint32_t reserved;
    struct esaac_image_memory hdr;
    struct esaac_image_memory motion;
};

struct esaac_brought {
    struct esaac_header header;
    struct esaac_image_memory hdr;
    struct esaac_image_memory motion;
};

struct esaac_frame {
    struct esaac_header header;
    uint32_t slot;
    uint32_t device_copies; /* between what rendered the frame and the slot */
    uint32_t host_copies;
    uint32_t reserved;
    uint64_t value; /* of the slot's timeline: 2k + 1 for its k-th frame, k from 0 */
    int64_t t_ns;   /* later than that of the last frame, by a second at most; within +-2^62 */
};

struct esaac_released {
    struct esaac_header header;
    uint32_t slot;
    uint32_t outcome;
    uint64_t value; /* 2k + 2 */
};

enum esaac_error_code {
    ESAAC_ERROR_INTERNAL = 0, /* anything else */
    ESAAC_ERROR_PROTOCOL = 1, /* a message that is none, or not now */
    ESAAC_ERROR_VERSION = 2, /* another version of the protocol */
    ESAAC_ERROR_CAMERA = 3, /* no camera of this number, or of another size */
    ESAAC_ERROR_TAKEN = 4, /* the camera has a producer */
    ESAAC_ERROR_DEVICE = 5, /* another device or driver, and no memory that both can use */
    ESAAC_ERROR_UNSUPPORTED = 6, /* no memory or timeline that both can use */
    ESAAC_ERROR_MEMORY = 7, /* memory that is not what it must be */
    ESAAC_ERROR_VALUE = 8, /* a timeline value out of turn */
    ESAAC_ERROR_TIME = 9, /* a frame's time */
    ESAAC_ERROR_TIMEOUT = 10, /* something that did not come */
    ESAAC_ERROR_USER = 11, /* another user's process */
    ESAAC_ERROR_BUSY = 12, /* more connections without a ring than the engine answers at once: try again */
    ESAAC_ERROR_POSES = 13, /* poses that are none, or that do not span the frame's interval; version 2 */
};

struct esaac_error {
    struct esaac_header header;
    uint32_t code; /* enum esaac_error_code; an engine may know more */
    uint32_t text_bytes;
    uint8_t text[256]; /* UTF-8 */
};

/* Version 2. */

#define ESAAC_NO_PLANE 0u       /* no depth, no ids */
#define ESAAC_GIVES_GEOMETRY 1u /* HELLO: depth, ids and poses come where the camera takes them */
#define ESAAC_CAMERA 0u         /* a track of the camera's; 0 is the static world, which has no poses */
#define ESAAC_MAX_BYTES 65536u  /* of a message */
#define ESAAC_MAX_SAMPLES 1000u /* of a track */
#define ESAAC_MAX_POSES 65536u  /* samples of all tracks of a frame */

enum esaac_depth_format { ESAAC_DEPTH_F32 = 1 };
enum esaac_id_format { ESAAC_ID_U16 = 1, ESAAC_ID_U32 = 2 };
enum esaac_projection { ESAAC_NO_LENS = 0, ESAAC_PINHOLE = 1, ESAAC_FISHEYE = 2 };

/* A pixel at x, y shows the direction ((x - cx) / fx, (y - cy) / fy); y goes down, and 0, 0 is the centre of the first
 * pixel. Depth is metres along the optical axis with a pinhole, from the camera's centre with a fisheye (equidistant:
 * fx and fy are pixels a radian). Infinity or 0 is a background at infinity. */
struct esaac_lens {
    uint32_t projection; /* enum esaac_projection */
    uint32_t reserved;
    double fx_px;
    double fy_px;
    double cx_px;
    double cy_px;
};

struct esaac_hello_2 {
    struct esaac_header header;
    uint8_t device_uuid[16];
    uint8_t driver_uuid[16];
    uint32_t camera;
    uint32_t width_px;
    uint32_t height_px;
    uint32_t memories;
    uint32_t timelines;
    uint32_t gives;         /* ESAAC_GIVES_GEOMETRY or 0 */
    struct esaac_lens lens; /* that it renders with, if it gives geometry; ESAAC_NO_LENS for as the rig has it */
};

struct esaac_ring_2 {
    struct esaac_header header;
    uint8_t device_uuid[16];
    uint8_t driver_uuid[16];
    uint32_t camera;
    uint32_t cameras;
    uint32_t width_px;
    uint32_t height_px;
    uint32_t hdr_format;
    uint32_t motion_format;
    uint32_t memory;
    uint32_t timeline;
    uint32_t slots;
    uint32_t backpressure;
    uint32_t buffer_usage;
    uint32_t reserved;
    struct esaac_image_memory hdr;
    struct esaac_image_memory motion;
    struct esaac_image_memory depth;
    struct esaac_image_memory ids;
    uint32_t depth_format;  /* or ESAAC_NO_PLANE; with depth, poses come with every frame */
    uint32_t id_format;     /* or ESAAC_NO_PLANE */
    uint32_t max_instances; /* that may have poses */
    uint32_t reserved_2;
    struct esaac_lens lens; /* of depth and poses */
};

struct esaac_brought_2 {
    struct esaac_header header;
    struct esaac_image_memory hdr;
    struct esaac_image_memory motion;
    struct esaac_image_memory depth;
    struct esaac_image_memory ids;
};

struct esaac_frame_2 {
    struct esaac_header header;
    uint32_t slot;
    uint32_t device_copies;
    uint32_t host_copies;
    uint32_t poses; /* samples in the POSES messages since the last FRAME */
    uint64_t value;
    int64_t t_ns;
};

/* POSES: this, then for each track its head and its samples. A frame may have many POSES messages; a track is whole in
 * one of them. */
struct esaac_poses {
    struct esaac_header header;
    uint32_t tracks;
    uint32_t reserved;
};

struct esaac_track {
    uint32_t instance; /* ESAAC_CAMERA, or an id of the id image */
    uint32_t samples;  /* that follow, at ascending times; one alone stands still */
};

/* World from body. The camera looks along -z, x right, y up. */
struct esaac_sample {
    int64_t t_ns;
    double position_m[3];    /* x y z */
    double quaternion[4];    /* of unit length: x y z w */
};

#ifndef __cplusplus
_Static_assert(sizeof(struct esaac_header) == 16, "header");
_Static_assert(sizeof(struct esaac_image_memory) == 24, "image memory");
_Static_assert(sizeof(struct esaac_hello) == 72, "HELLO");
_Static_assert(sizeof(struct esaac_ring) == 144, "RING");
_Static_assert(sizeof(struct esaac_brought) == 64, "BROUGHT");
_Static_assert(sizeof(struct esaac_frame) == 48, "FRAME");
_Static_assert(sizeof(struct esaac_released) == 32, "RELEASED");
_Static_assert(sizeof(struct esaac_error) == 280, "ERROR");
_Static_assert(sizeof(struct esaac_lens) == 40, "lens");
_Static_assert(sizeof(struct esaac_hello_2) == 112, "HELLO, version 2");
_Static_assert(sizeof(struct esaac_ring_2) == 248, "RING, version 2");
_Static_assert(sizeof(struct esaac_brought_2) == 112, "BROUGHT, version 2");
_Static_assert(sizeof(struct esaac_frame_2) == 48, "FRAME, version 2");
_Static_assert(sizeof(struct esaac_poses) == 24, "POSES");
_Static_assert(sizeof(struct esaac_track) == 8, "track");
_Static_assert(sizeof(struct esaac_sample) == 64, "sample");
#endif

#endif
