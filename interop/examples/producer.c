/* A producer in plain Vulkan: fills each frame with one gray that changes from frame to frame. If the camera takes depth,
 * it is a wall two metres before a camera that moves to the right.
 *
 * cc -std=c11 -I include examples/producer.c -lvulkan -o producer
 * ./producer SOCKET FRAMES [CAMERA [DEVICE]] */
#define _GNU_SOURCE
#include "esaac_interop.h"
#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>
#include <vulkan/vulkan.h>

#define FAIL(...) (fprintf(stderr, __VA_ARGS__), fputc('\n', stderr), exit(1))
#define VK(call) do { VkResult r_ = (call); if (r_ != VK_SUCCESS) FAIL("%s: %d", #call, r_); } while (0)
#define IMAGES 4 /* colour, motion, depth, ids */

union message {
    struct esaac_header header;
    struct esaac_ring_2 ring;
    struct esaac_released released;
    struct esaac_error error;
};

static void send_message(int sock, void *message, uint16_t kind, uint32_t bytes) {
    *(struct esaac_header *)message = (struct esaac_header){ESAAC_MAGIC, ESAAC_VERSION_2, kind, bytes, 0};
    if (send(sock, message, bytes, MSG_NOSIGNAL) == (ssize_t)bytes) return;
    /* The engine has closed the connection. What it said before can still be read. */
    union message last;
    for (int look = 0; look < 2; look++) {
        ssize_t got = recv(sock, &last, sizeof last, MSG_DONTWAIT);
        if (got >= (ssize_t)sizeof last.header && last.header.kind == ESAAC_ERROR) FAIL("refused: %.*s", (int)last.error.text_bytes, last.error.text);
    }
    FAIL("the engine is gone");
}

/* The next message, which must be of this kind; its descriptors. */
static int receive(int sock, union message *message, uint16_t kind, int *fds) {
    union { struct cmsghdr align; char bytes[CMSG_SPACE(sizeof(int) * (IMAGES + 1) * ESAAC_MAX_SLOTS)]; } control;
    struct iovec iov = {message, sizeof *message};
    struct msghdr header = {.msg_iov = &iov, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ssize_t bytes = recvmsg(sock, &header, MSG_CMSG_CLOEXEC);
    /* A connection that is closed with messages unread says so once, before its last message. */
    if (bytes < 0 && errno == ECONNRESET) bytes = recvmsg(sock, &header, MSG_CMSG_CLOEXEC);
    if (bytes < (ssize_t)sizeof message->header) FAIL("the engine is gone");
    if (message->header.kind == ESAAC_ERROR) FAIL("refused: %.*s", (int)message->error.text_bytes, message->error.text);
    if (message->header.kind != kind || (ssize_t)message->header.bytes != bytes) FAIL("message %u, expected %u", message->header.kind, kind);
    struct cmsghdr *cmsg = CMSG_FIRSTHDR(&header);
    int count = cmsg ? (int)((cmsg->cmsg_len - CMSG_LEN(0)) / sizeof(int)) : 0;
    if (fds && cmsg) memcpy(fds, CMSG_DATA(cmsg), count * sizeof(int));
    return count;
}

/* The engine's memory as a buffer here. The driver takes the descriptor over. */
static VkBuffer import(VkDevice device, int fd, uint32_t usage, const struct esaac_image_memory *memory) {
    VkExternalMemoryBufferCreateInfo external = {VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO, NULL, VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT};
    VkBufferCreateInfo buffer_info = {VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, &external, .size = memory->bytes, .usage = usage};
    VkBuffer buffer;
    VK(vkCreateBuffer(device, &buffer_info, NULL, &buffer));
    VkMemoryAllocateFlagsInfo flags = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO, NULL, VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT, 0};
    VkMemoryDedicatedAllocateInfo dedicated = {VK_STRUCTURE_TYPE_MEMORY_DEDICATED_ALLOCATE_INFO, &flags, .buffer = buffer};
    VkImportMemoryFdInfoKHR fd_info = {VK_STRUCTURE_TYPE_IMPORT_MEMORY_FD_INFO_KHR, &dedicated, VK_EXTERNAL_MEMORY_HANDLE_TYPE_OPAQUE_FD_BIT, fd};
    VkMemoryAllocateInfo info = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, &fd_info, memory->allocation_bytes, memory->memory_type};
    VkMemoryRequirements required;
    vkGetBufferMemoryRequirements(device, buffer, &required);
    if (required.size != info.allocationSize) FAIL("the driver wants %llu bytes", (unsigned long long)required.size);
    VkDeviceMemory bound;
    VK(vkAllocateMemory(device, &info, NULL, &bound));
    VK(vkBindBufferMemory(device, buffer, bound, 0));
    return buffer;
}

/* A file of the engine's as a buffer here: mapped, and the mapping given to the driver. The file can be closed then. */
static VkBuffer import_host(VkDevice device, int fd, uint32_t usage, const struct esaac_image_memory *memory) {
    struct stat file;
    if (fstat(fd, &file) || (uint64_t)file.st_size != memory->allocation_bytes) FAIL("the engine's file is not as long as it says");
    void *mapping = mmap(NULL, memory->allocation_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (mapping == MAP_FAILED) FAIL("the engine's file cannot be mapped");
    close(fd);
    const VkExternalMemoryHandleTypeFlagBits type = VK_EXTERNAL_MEMORY_HANDLE_TYPE_HOST_ALLOCATION_BIT_EXT;
    VkExternalMemoryBufferCreateInfo external = {VK_STRUCTURE_TYPE_EXTERNAL_MEMORY_BUFFER_CREATE_INFO, NULL, type};
    VkBufferCreateInfo buffer_info = {VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, &external, .size = memory->bytes, .usage = usage};
    VkBuffer buffer;
    VK(vkCreateBuffer(device, &buffer_info, NULL, &buffer));
    VkMemoryRequirements required;
    vkGetBufferMemoryRequirements(device, buffer, &required);
    PFN_vkGetMemoryHostPointerPropertiesEXT ask = (PFN_vkGetMemoryHostPointerPropertiesEXT)vkGetDeviceProcAddr(device, "vkGetMemoryHostPointerPropertiesEXT");
    VkMemoryHostPointerPropertiesEXT properties = {.sType = VK_STRUCTURE_TYPE_MEMORY_HOST_POINTER_PROPERTIES_EXT};
    VK(ask(device, type, mapping, &properties));
    const uint32_t types = required.memoryTypeBits & properties.memoryTypeBits;
    if (!types || required.size > memory->allocation_bytes) FAIL("the driver does not take the engine's file");
    uint32_t first = 0;
    while (!(types >> first & 1)) first++;
    VkMemoryAllocateFlagsInfo flags = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO, NULL, VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT, 0};
    VkImportMemoryHostPointerInfoEXT pointer = {VK_STRUCTURE_TYPE_IMPORT_MEMORY_HOST_POINTER_INFO_EXT, &flags, type, mapping};
    VkMemoryAllocateInfo info = {VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, &pointer, memory->allocation_bytes, first};
    VkDeviceMemory bound;
    VK(vkAllocateMemory(device, &info, NULL, &bound));
    VK(vkBindBufferMemory(device, buffer, bound, 0));
    return buffer;
}

/* Whether the device has an extension. */
static int has(VkPhysicalDevice physical, const char *name) {
    static VkExtensionProperties all[1024];
    uint32_t count = 1024;
    if (vkEnumerateDeviceExtensionProperties(physical, NULL, &count, all) < 0) return 0;
    for (uint32_t i = 0; i < count; i++)
        if (!strcmp(all[i].extensionName, name)) return 1;
    return 0;
}

/* Takes a buffer from the engine (EXTERNAL) or gives it back. */
static void hand_over(VkCommandBuffer commands, VkBuffer buffer, uint32_t from, uint32_t to) {
    VkBufferMemoryBarrier barrier = {VK_STRUCTURE_TYPE_BUFFER_MEMORY_BARRIER, NULL, VK_ACCESS_TRANSFER_WRITE_BIT, VK_ACCESS_TRANSFER_WRITE_BIT, from, to, buffer, 0, VK_WHOLE_SIZE};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_TRANSFER_BIT, VK_PIPELINE_STAGE_TRANSFER_BIT, 0, 0, NULL, 1, &barrier, 0, NULL);
}

/* The camera's poses from the last frame to this one, a sample a millisecond; how many. The engine must know where the
 * camera was throughout the interval. */
static uint32_t send_poses(int sock, int64_t from_ns, int64_t to_ns) {
    struct {
        struct esaac_poses head;
        struct esaac_track track;
        struct esaac_sample samples[ESAAC_MAX_SAMPLES];
    } poses = {.head.tracks = 1, .track.instance = ESAAC_CAMERA};
    const int64_t step_ns = 1000000;
    uint32_t count = 0;
    for (int64_t t_ns = from_ns; t_ns <= to_ns && count < ESAAC_MAX_SAMPLES; t_ns += step_ns)
        poses.samples[count++] = (struct esaac_sample){t_ns, {1e-9 * t_ns, 0, 0}, {0, 0, 0, 1}};
    poses.track.samples = count;
    send_message(sock, &poses, ESAAC_POSES, offsetof(__typeof__(poses), samples) + count * sizeof(struct esaac_sample));
    return count;
}

int main(int argc, char **argv) {
    if (argc < 3) FAIL("usage: producer SOCKET FRAMES [CAMERA [DEVICE]]");
    const uint32_t frames = strtoul(argv[2], NULL, 10), camera = argc > 3 ? strtoul(argv[3], NULL, 10) : 0;
    const uint32_t chosen = argc > 4 ? strtoul(argv[4], NULL, 10) : 0;

    VkApplicationInfo application = {VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_2};
    VkInstanceCreateInfo instance_info = {VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application};
    VkInstance instance;
    VK(vkCreateInstance(&instance_info, NULL, &instance));
    VkPhysicalDevice all[16];
    uint32_t count = 16;
    if (vkEnumeratePhysicalDevices(instance, &count, all) < 0 || chosen >= count) FAIL("no Vulkan device %u", chosen);
    VkPhysicalDeviceIDProperties id = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ID_PROPERTIES};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &id};
    vkGetPhysicalDeviceProperties2(all[chosen], &properties);
    VkQueueFamilyProperties families[16];
    uint32_t family_count = 16, family = 0;
    vkGetPhysicalDeviceQueueFamilyProperties(all[chosen], &family_count, families);
    while (family < family_count && !(families[family].queueFlags & VK_QUEUE_COMPUTE_BIT)) family++;
    float priority = 1;
    VkDeviceQueueCreateInfo queue_info = {VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO, NULL, 0, family, 1, &priority};
    /* The ring's buffers have device addresses. */
    VkPhysicalDeviceVulkan12Features features = {VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES, .bufferDeviceAddress = VK_TRUE};
    const char *extensions[2];
    uint32_t extension_count = 0, memories = 0;
    if (has(all[chosen], VK_KHR_EXTERNAL_MEMORY_FD_EXTENSION_NAME)) {
        extensions[extension_count++] = VK_KHR_EXTERNAL_MEMORY_FD_EXTENSION_NAME;
        memories |= ESAAC_MEMORY_EXPORTED;
    }
    if (has(all[chosen], VK_EXT_EXTERNAL_MEMORY_HOST_EXTENSION_NAME)) {
        extensions[extension_count++] = VK_EXT_EXTERNAL_MEMORY_HOST_EXTENSION_NAME;
        memories |= ESAAC_MEMORY_HOST;
    }
    VkDeviceCreateInfo device_info = {VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO, &features, 0, 1, &queue_info, 0, NULL, extension_count, extensions, NULL};
    VkDevice device;
    VK(vkCreateDevice(all[chosen], &device_info, NULL, &device));
    VkQueue queue;
    vkGetDeviceQueue(device, family, 0, &queue);

    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", argv[1]);
    int sock = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
    if (sock < 0 || connect(sock, (struct sockaddr *)&address, sizeof address)) FAIL("nobody serves at %s", argv[1]);
    struct esaac_hello_2 hello = {.camera = camera, .memories = memories, .timelines = ESAAC_TIMELINE_CARRIED, .gives = ESAAC_GIVES_GEOMETRY};
    memcpy(hello.device_uuid, id.deviceUUID, 16);
    memcpy(hello.driver_uuid, id.driverUUID, 16);
    send_message(sock, &hello, ESAAC_HELLO, sizeof hello);

    union message message;
    int fds[(IMAGES + 1) * ESAAC_MAX_SLOTS];
    int fd_count = receive(sock, &message, ESAAC_RING, fds);
    const struct esaac_ring_2 ring = message.ring;
    /* The images that the camera takes, in the order of their descriptors, and what each is filled with. */
    const struct esaac_image_memory *memory[IMAGES] = {&ring.hdr};
    uint32_t fill[IMAGES] = {0}, images = 1;
    if (ring.motion_format != ESAAC_NO_MOTION) memory[images++] = &ring.motion;
    if (ring.depth_format == ESAAC_DEPTH_F32) fill[images] = 0x40000000 /* 2.0 */, memory[images++] = &ring.depth;
    if (ring.id_format != ESAAC_NO_PLANE) memory[images++] = &ring.ids; /* 0, the static world */
    if (ring.hdr_format != ESAAC_HDR_F16X4 || ring.slots > ESAAC_MAX_SLOTS || fd_count != (int)(ring.slots * images)) FAIL("a ring for f16x4 colour was expected");
    VkBuffer buffers[ESAAC_MAX_SLOTS][IMAGES];
    uint64_t values[ESAAC_MAX_SLOTS] = {0};
    for (uint32_t slot = 0; slot < ring.slots; slot++)
        for (uint32_t image = 0; image < images; image++)
            buffers[slot][image] = (ring.memory == ESAAC_MEMORY_HOST ? import_host : import)(
                device, fds[slot * images + image], ring.buffer_usage, memory[image]);

    VkCommandPoolCreateInfo pool_info = {VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, NULL, VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT, family};
    VkCommandPool pool;
    VK(vkCreateCommandPool(device, &pool_info, NULL, &pool));
    VkCommandBufferAllocateInfo commands_info = {VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, NULL, pool, VK_COMMAND_BUFFER_LEVEL_PRIMARY, 1};
    VkCommandBuffer commands;
    VK(vkAllocateCommandBuffers(device, &commands_info, &commands));
    for (uint32_t frame = 0; frame < frames + ring.slots; frame++) {
        uint32_t slot = frame; /* all are free at first */
        if (frame >= ring.slots) {
            receive(sock, &message, ESAAC_RELEASED, NULL);
            slot = message.released.slot;
            if (slot >= ring.slots || message.released.value != ++values[slot]) FAIL("slot %u out of turn", slot);
        }
        if (frame >= frames) continue; /* only to see the last slots come back */
        /* Two f16 in a word: 1.0 and, every other frame, 2.0 or 4.0. */
        fill[0] = frame % 2 == 0 ? 0x3c003c00 : frame % 4 == 1 ? 0x40004000 : 0x44004400;
        VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
        VK(vkBeginCommandBuffer(commands, &begin));
        for (uint32_t image = 0; image < images; image++) {
            hand_over(commands, buffers[slot][image], VK_QUEUE_FAMILY_EXTERNAL, family);
            vkCmdFillBuffer(commands, buffers[slot][image], 0, VK_WHOLE_SIZE, fill[image]);
            hand_over(commands, buffers[slot][image], family, VK_QUEUE_FAMILY_EXTERNAL);
        }
        VK(vkEndCommandBuffer(commands));
        VkSubmitInfo submit = {VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
        VK(vkQueueSubmit(queue, 1, &submit, VK_NULL_HANDLE));
        VK(vkQueueWaitIdle(queue)); /* a carried timeline: done before it is told */
        const int64_t t_ns = (int64_t)frame * 10000000;
        const uint32_t poses = ring.depth_format == ESAAC_NO_PLANE ? 0 : send_poses(sock, frame ? t_ns - 10000000 : t_ns, t_ns);
        struct esaac_frame_2 told = {.slot = slot, .poses = poses, .value = ++values[slot], .t_ns = t_ns};
        send_message(sock, &told, ESAAC_FRAME, sizeof told);
    }
    struct esaac_header bye;
    send_message(sock, &bye, ESAAC_BYE, sizeof bye);
    printf("%u frames by memory %u, %s\n", frames, ring.memory, ring.depth_format == ESAAC_NO_PLANE ? "without poses" : "with poses");
    return 0; /* the process takes buffers, memory and device with it */
}
