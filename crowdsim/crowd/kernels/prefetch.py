"""Prefetching: memory is requested some time before it is read."""

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from crowdsim.jit import kernel

_LINE = 64  # of memory [bytes]


@intrinsic
def prefetch(typing, array, index):
    """Request an entry along the first axis of an array that will be read soon; any index will do."""

    def generate(context, builder, signature, values):
        found = make_array(signature.args[0])(context, builder, values[0])
        byte, number = cgutils.voidptr_t, cgutils.int32_t
        kind = cgutils.ir.FunctionType(cgutils.ir.VoidType(), [byte, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        offset = builder.mul(values[1], cgutils.unpack_tuple(builder, found.strides)[0])
        pointer = builder.gep(builder.bitcast(found.data, byte), [offset])
        size = array.dtype.size if isinstance(array.dtype, types.Record) else 1
        for start in range(0, size, _LINE):
            at = builder.gep(pointer, [context.get_constant(types.intp, start)])
            builder.call(function, [at, number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(array, types.int64), generate


@kernel(inline=True)
def prefetch_avatar(avatars, i):
    """Prefetch what avatars see of the avatar in a slot."""
    prefetch(avatars.motion, i)
    prefetch(avatars.playback, i)
    prefetch(avatars.x, i)
    prefetch(avatars.z, i)
    prefetch(avatars.heading, i)
    prefetch(avatars.number, i)
    prefetch(avatars.team, i)
    prefetch(avatars.opponent, i)
    prefetch(avatars.policy, i)
