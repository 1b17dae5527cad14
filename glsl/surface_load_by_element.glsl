// Loads of surfaces and poses, as GPUs read fastest. Macros, since not every kernel has all of these buffers.

#define SURFACE_WORDS(element) surfaces[element]
#define SLOPE_WORD(element) slopes[element]
#define POSE_ROW(row) poses[row]
#define PATH_ROW(row) paths[row]
