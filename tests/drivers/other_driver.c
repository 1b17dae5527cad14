/* A Vulkan layer that makes the driver below it one with less: for machines that nobody has here.
 *
 *   ESAAC_DRIVER_LACKS   names of device extensions that it does not have, separated by spaces
 *   ESAAC_DRIVER_UUIDS   if set, every physical device has a UUID of its own (copies of one driver share theirs)
 *   ESAAC_DRIVER_FULL    bytes that imports of memory may take in all; after that they are out of memory
 *   ESAAC_DRIVER_ANONYMOUS  if set, memory of the host that is a mapped file is refused, as amdgpu does
 */
#include <inttypes.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vk_layer.h>
#include <vulkan/vulkan.h>

#define EXPORT __attribute__((visibility("default")))
#define LENGTH(array) (sizeof(array) / sizeof *(array))

/* The loader's table, first in every handle, is the same for an instance and its physical devices. */
struct instance {
    void *table;
    VkInstance instance;
    PFN_vkGetInstanceProcAddr next;
    PFN_vkCreateDevice create_device;
    PFN_vkEnumeratePhysicalDevices enumerate_devices;
    PFN_vkEnumerateDeviceExtensionProperties enumerate_extensions;
    PFN_vkGetPhysicalDeviceProperties2 get_properties;
};
struct device {
    void *table;
    PFN_vkGetDeviceProcAddr next;
    PFN_vkAllocateMemory allocate;
};
static struct instance instances[64];
static struct device devices[64];
static atomic_ullong imported;

static void *table_of(void *handle) { return *(void **)handle; }

static struct instance *instance_of(void *handle) {
    for (size_t i = 0; i < LENGTH(instances); i++)
        if (instances[i].table == table_of(handle)) return &instances[i];
    fputs("other_driver: an instance that was not made here\n", stderr);
    abort();
}

static struct device *device_of(void *handle) {
    for (size_t i = 0; i < LENGTH(devices); i++)
        if (devices[i].table == table_of(handle)) return &devices[i];
    fputs("other_driver: a device that was not made here\n", stderr);
    abort();
}

static int lacks(const char *extension) {
    const char *names = getenv("ESAAC_DRIVER_LACKS"), *at = names;
    size_t length = strlen(extension);
    for (; at && (at = strstr(at, extension)); at += length)
        if ((at == names || at[-1] == ' ') && (at[length] == ' ' || at[length] == 0)) return 1;
    return 0;
}

static uint8_t number_of(VkPhysicalDevice physical) {
    struct instance *own = instance_of(physical);
    VkPhysicalDevice all[16];
    uint32_t count = LENGTH(all);
    own->enumerate_devices(own->instance, &count, all);
    for (uint32_t i = 0; i < count; i++)
        if (all[i] == physical) return (uint8_t)i;
    return 255;
}

static VkResult VKAPI_CALL create_instance(const VkInstanceCreateInfo *info, const VkAllocationCallbacks *with,
                                           VkInstance *made) {
    VkLayerInstanceCreateInfo *link = (void *)info->pNext;
    while (link->sType != VK_STRUCTURE_TYPE_LOADER_INSTANCE_CREATE_INFO || link->function != VK_LAYER_LINK_INFO)
        link = (void *)link->pNext;
    PFN_vkGetInstanceProcAddr next = link->u.pLayerInfo->pfnNextGetInstanceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    VkResult result = ((PFN_vkCreateInstance)next(NULL, "vkCreateInstance"))(info, with, made);
    if (result != VK_SUCCESS) return result;
    /* Tables are used again after their instance is gone, with the same functions behind them. */
    for (size_t i = 0; i < LENGTH(instances); i++) {
        if (instances[i].table && instances[i].table != table_of(*made)) continue;
        /* Asked for now: once the instance is whole the loader's answer is this layer. */
        instances[i] = (struct instance){
            .table = table_of(*made),
            .instance = *made,
            .next = next,
            .create_device = (void *)next(*made, "vkCreateDevice"),
            .enumerate_devices = (void *)next(*made, "vkEnumeratePhysicalDevices"),
            .enumerate_extensions = (void *)next(*made, "vkEnumerateDeviceExtensionProperties"),
            .get_properties = (void *)next(*made, "vkGetPhysicalDeviceProperties2"),
        };
        return VK_SUCCESS;
    }
    return VK_ERROR_INITIALIZATION_FAILED;
}

static VkResult VKAPI_CALL create_device(VkPhysicalDevice physical, const VkDeviceCreateInfo *info,
                                         const VkAllocationCallbacks *with, VkDevice *made) {
    VkLayerDeviceCreateInfo *link = (void *)info->pNext;
    while (link->sType != VK_STRUCTURE_TYPE_LOADER_DEVICE_CREATE_INFO || link->function != VK_LAYER_LINK_INFO)
        link = (void *)link->pNext;
    struct instance *own = instance_of(physical);
    PFN_vkGetDeviceProcAddr next = link->u.pLayerInfo->pfnNextGetDeviceProcAddr;
    link->u.pLayerInfo = link->u.pLayerInfo->pNext;
    VkResult result = own->create_device(physical, info, with, made);
    if (result != VK_SUCCESS) return result;
    for (size_t i = 0; i < LENGTH(devices); i++) {
        if (devices[i].table && devices[i].table != table_of(*made)) continue;
        devices[i] = (struct device){table_of(*made), next, (void *)next(*made, "vkAllocateMemory")};
        return VK_SUCCESS;
    }
    return VK_ERROR_INITIALIZATION_FAILED;
}

static VkResult VKAPI_CALL enumerate_extensions(VkPhysicalDevice physical, const char *layer, uint32_t *count,
                                                VkExtensionProperties *properties) {
    PFN_vkEnumerateDeviceExtensionProperties next = instance_of(physical)->enumerate_extensions;
    uint32_t all = 0, kept = 0;
    VkResult result = next(physical, layer, &all, NULL);
    VkExtensionProperties *list = calloc(all + 1, sizeof *list);
    if (result == VK_SUCCESS) result = next(physical, layer, &all, list);
    for (uint32_t i = 0; i < all; i++) {
        if (lacks(list[i].extensionName)) continue;
        if (properties && kept < *count) properties[kept] = list[i];
        kept++;
    }
    free(list);
    if (properties && kept > *count) return VK_INCOMPLETE;
    *count = kept;
    return result;
}

static void VKAPI_CALL get_properties(VkPhysicalDevice physical, VkPhysicalDeviceProperties2 *properties) {
    instance_of(physical)->get_properties(physical, properties);
    if (!getenv("ESAAC_DRIVER_UUIDS")) return;
    for (VkBaseOutStructure *at = properties->pNext; at; at = at->pNext)
        if (at->sType == VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ID_PROPERTIES)
            ((VkPhysicalDeviceIDProperties *)at)->deviceUUID[15] ^= number_of(physical);
}

/* Whether an address lies in the mapping of a file. */
static int is_of_a_file(const void *address) {
    FILE *maps = fopen("/proc/self/maps", "r");
    char line[4096];
    int found = 0;
    while (maps && !found && fgets(line, sizeof line, maps)) {
        uintptr_t start, end;
        unsigned long inode;
        if (sscanf(line, "%" SCNxPTR "-%" SCNxPTR " %*s %*s %*s %lu", &start, &end, &inode) == 3)
            found = start <= (uintptr_t)address && (uintptr_t)address < end && inode != 0;
    }
    if (maps) fclose(maps);
    return found;
}

static VkResult VKAPI_CALL allocate(VkDevice device, const VkMemoryAllocateInfo *info,
                                    const VkAllocationCallbacks *with, VkDeviceMemory *memory) {
    const char *full = getenv("ESAAC_DRIVER_FULL");
    for (const VkBaseInStructure *at = info->pNext; full && at; at = at->pNext) {
        if (at->sType != VK_STRUCTURE_TYPE_IMPORT_MEMORY_FD_INFO_KHR) continue;
        if (atomic_fetch_add(&imported, info->allocationSize) + info->allocationSize > strtoull(full, NULL, 10))
            return VK_ERROR_OUT_OF_DEVICE_MEMORY;
    }
    for (const VkBaseInStructure *at = info->pNext; getenv("ESAAC_DRIVER_ANONYMOUS") && at; at = at->pNext)
        if (at->sType == VK_STRUCTURE_TYPE_IMPORT_MEMORY_HOST_POINTER_INFO_EXT
            && is_of_a_file(((const VkImportMemoryHostPointerInfoEXT *)at)->pHostPointer))
            return VK_ERROR_INVALID_EXTERNAL_HANDLE;
    return device_of(device)->allocate(device, info, with, memory);
}

static PFN_vkVoidFunction VKAPI_CALL device_function(VkDevice device, const char *name) {
    if (!strcmp(name, "vkGetDeviceProcAddr")) return (PFN_vkVoidFunction)device_function;
    if (!strcmp(name, "vkAllocateMemory")) return (PFN_vkVoidFunction)allocate;
    return device_of(device)->next(device, name);
}

static PFN_vkVoidFunction VKAPI_CALL instance_function(VkInstance instance, const char *name) {
    static const struct {
        const char *name;
        PFN_vkVoidFunction function;
    } own[] = {
        {"vkGetInstanceProcAddr", (PFN_vkVoidFunction)instance_function},
        {"vkGetDeviceProcAddr", (PFN_vkVoidFunction)device_function},
        {"vkCreateInstance", (PFN_vkVoidFunction)create_instance},
        {"vkCreateDevice", (PFN_vkVoidFunction)create_device},
        {"vkEnumerateDeviceExtensionProperties", (PFN_vkVoidFunction)enumerate_extensions},
        {"vkGetPhysicalDeviceProperties2", (PFN_vkVoidFunction)get_properties},
        {"vkAllocateMemory", (PFN_vkVoidFunction)allocate},
    };
    for (size_t i = 0; i < LENGTH(own); i++)
        if (!strcmp(name, own[i].name)) return own[i].function;
    return instance ? instance_of(instance)->next(instance, name) : NULL;
}

EXPORT VkResult VKAPI_CALL vkNegotiateLoaderLayerInterfaceVersion(VkNegotiateLayerInterface *interface) {
    interface->loaderLayerInterfaceVersion = 2;
    interface->pfnGetInstanceProcAddr = instance_function;
    interface->pfnGetDeviceProcAddr = device_function;
    interface->pfnGetPhysicalDeviceProcAddr = NULL;
    return VK_SUCCESS;
}
