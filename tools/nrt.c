/* The memory of kernels' own arrays and lists: what the code that numba makes asks of a block. */
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

typedef void (*destroyer)(void *, size_t, void *);

typedef struct {
    size_t references; /* kernels count them by themselves */
    destroyer destroy; /* of a list: what is called before its data goes */
    void *destroyed_with;
    void *data;
    size_t size;
    void *grows; /* not NULL where the data lies apart from the block, because it may grow */
} block;

static block *filled(block *made, size_t size) {
    made->references = 1;
    made->destroy = NULL;
    made->destroyed_with = made->grows = NULL;
    made->size = size;
    return made;
}

void *NRT_MemInfo_alloc_aligned(size_t size, unsigned align) {
    block *made = malloc(sizeof(block) + size + align);
    if (made == NULL) return NULL;
    made->data = (void *)(((uintptr_t)(made + 1) + align - 1) / align * align);
    return filled(made, size);
}

void *NRT_MemInfo_alloc(size_t size) { return NRT_MemInfo_alloc_aligned(size, 2 * sizeof(void *)); }

void *NRT_MemInfo_new_varsize_dtor(size_t size, destroyer destroy) {
    block *made = malloc(sizeof(block));
    void *data = malloc(size);
    if (made == NULL || data == NULL) {
        free(made);
        free(data);
        return NULL;
    }
    filled(made, size);
    made->data = made->grows = data;
    made->destroy = destroy;
    return made;
}

void *NRT_MemInfo_varsize_realloc(void *list, size_t size) {
    block *made = list;
    void *data = realloc(made->data, size);
    if (data == NULL) return NULL;
    made->data = made->grows = data;
    made->size = size;
    return data;
}

void NRT_MemInfo_call_dtor(void *dead) {
    block *made = dead;
    if (made->destroy != NULL) made->destroy(made->data, made->size, made->destroyed_with);
    if (made->grows != NULL) free(made->grows);
    free(made);
}

void *NRT_Allocate(size_t size) { return malloc(size); }

void NRT_Free(void *dead) { free(dead); }
