"""Prefetching: memory is requested some time before it is read."""

from numba import literal_unroll, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from crowdsim.jit import kernel


@intrinsic
def _request(typing, array, index):
    """Ask memory for an entry of an array."""

    def generate(context, builder, signature, values):
        pointer = builder.gep(make_array(signature.args[0])(context, builder, values[0]).data, [values[1]])
        byte, number = cgutils.voidptr_t, cgutils.int32_t
        kind = cgutils.ir.FunctionType(cgutils.ir.VoidType(), [byte, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        builder.call(function, [builder.bitcast(pointer, byte), number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(array, types.int64), generate


@kernel(inline=True)
def ask_for(array, index):
    """Ask memory for an entry, counted from the first one, of an array that will be read soon; any index will do."""
    _request(array, index)  # type: ignore[call-arg]


@kernel(inline=True)
def ask_for_rows(array, rows, column):
    """Ask memory for a column of some rows of an array."""
    for row in literal_unroll(rows):
        _request(array, row * array.shape[1] + column)  # type: ignore[call-arg]
