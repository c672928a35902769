"""Compiled number work of BVH files: text to numbers and numbers to text."""

import numpy as np

from crowdsim.jit import kernel

_POWER_LIMIT = 270


def _powers_of_ten():
    """Return 10**e for |e| <= 270 as sums of two floats, exact to 106 bits."""
    high = np.empty(2 * _POWER_LIMIT + 1)
    low = np.empty(2 * _POWER_LIMIT + 1)
    for e in range(-_POWER_LIMIT, _POWER_LIMIT + 1):
        ten = 10 ** abs(e)
        first = float(ten) if e >= 0 else 1 / ten
        numerator, denominator = first.as_integer_ratio()
        rest = ten * denominator - numerator if e >= 0 else denominator - numerator * ten
        high[e + _POWER_LIMIT] = first
        low[e + _POWER_LIMIT] = rest / (denominator if e >= 0 else denominator * ten)
    return high, low


_HIGH, _LOW = _powers_of_ten()
_PAIRS = np.array([48 + digit for pair in range(100) for digit in (pair // 10, pair % 10)], np.uint8)
_LEFT = np.array([[*(48 + int(digit) for digit in f"{n:<3}".replace(" ", "0")), len(str(n))] for n in range(1000)])
_LEFT = _LEFT.astype(np.uint8).reshape(-1)


@kernel(inline=True)
def _rounded_off(a, b, product):
    """Return what rounding has taken from the product of two floats, exactly (Dekker 1971)."""
    t = 134217729.0 * a
    a_high = t - (t - a)
    a_low = a - a_high
    t = 134217729.0 * b
    b_high = t - (t - b)
    b_low = b - b_high
    return ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


@kernel
def _scale_decimal(mantissa, exponent, truncated):
    """Return mantissa * 10**exponent rounded once, and whether that rounding is certain."""
    if mantissa <= 9007199254740992 and not truncated:
        if -22 <= exponent <= 22:
            if exponent < 0:
                return mantissa / _HIGH[_POWER_LIMIT - exponent], True
            return mantissa * _HIGH[_POWER_LIMIT + exponent], True
        if mantissa == 0:
            return 0.0, True
    if exponent < -_POWER_LIMIT or exponent > _POWER_LIMIT:
        return 0.0, False
    power, power_rest = _HIGH[exponent + _POWER_LIMIT], _LOW[exponent + _POWER_LIMIT]
    whole = float(mantissa)
    whole_rest = float(mantissa - np.int64(whole))
    product = whole * power
    rest = _rounded_off(whole, power, product) + (whole * power_rest + whole_rest * power)
    value = product + rest
    rest -= value - product
    doubt = abs(value) * 3e-30
    if truncated:
        doubt += abs(value) / whole
    return value, value + (rest + doubt) == value and value + (rest - doubt) == value


@kernel
def _read_long(data, start, stop):
    """Return the first 18 digits of a number, the power of ten behind them, and whether others were lost."""
    mantissa = np.int64(0)
    digits = 0
    exponent = 0
    lost = False
    behind_point = False
    for at in range(start, stop):
        if data[at] == 46 or data[at] == 44:
            behind_point = True
            continue
        digit = np.int64(data[at]) - 48
        if digits < 18:
            mantissa = mantissa * 10 + digit
            digits += mantissa > 0
            exponent -= behind_point
        else:
            lost = lost or digit > 0
            exponent += not behind_point
    return mantissa, exponent, lost


@kernel
def parse_numbers(data, stop, columns, out, hard, state):
    """Read decimal numbers of ``data`` (uint8) up to ``stop`` into ``out``, which ends it when full.

    A comma does for a decimal point. Tokens that are no plain decimals go to ``hard`` as (number, start, stop); it
    stops when that is full. ``state`` carries on between calls: place in the data, numbers read, hard tokens of this
    call, numbers on this line, and lines that hold another count of numbers than ``columns``. Places are unsigned,
    which spares a test for negative ones.
    """
    at, end = np.uint64(state[0]), np.uint64(stop)
    one, ten = np.uint64(1), np.uint64(10)
    count, hards, on_line, odd_lines = state[1], np.int64(0), state[3], state[4]
    while at < end:
        byte = data[at]
        if byte == 32 or (9 <= byte <= 13):
            if (byte == 10 or byte == 13) and on_line > 0:
                odd_lines += on_line != columns
                on_line = 0
            at += one
            continue
        if count >= out.shape[0] or hards >= hard.shape[0]:
            break
        first = at
        negative = byte == 45
        at += np.uint64(negative or byte == 43)
        number_at = at
        mantissa = np.uint64(0)
        while at < end:
            digit = np.uint64(data[at]) - np.uint64(48)
            if digit > np.uint64(9):
                break
            mantissa = mantissa * ten + digit
            at += one
        digits = at - number_at
        point_shift = np.int64(0)
        if at < end and (data[at] == 46 or data[at] == 44):
            at += one
            point = at
            while at < end:
                digit = np.uint64(data[at]) - np.uint64(48)
                if digit > np.uint64(9):
                    break
                mantissa = mantissa * ten + digit
                at += one
            digits += at - point
            point_shift = -np.int64(at - point)
        number_end = at
        power = np.int64(0)
        plain = digits > np.uint64(0)
        if at < end and (data[at] == 101 or data[at] == 69) and plain:
            at += one
            minus = at < end and data[at] == 45
            at += np.uint64(minus or (at < end and data[at] == 43))
            power_at = at
            while at < end:
                digit = np.uint64(data[at]) - np.uint64(48)
                if digit > np.uint64(9):
                    break
                power = min(power * 10 + np.int64(digit), 100000)
                at += one
            plain = at > power_at
            power = -power if minus else power
        if plain and at < end:
            byte = data[at]
            plain = byte == 32 or (9 <= byte <= 13)
        if plain:
            whole = np.int64(mantissa)
            exponent = power + point_shift
            if digits <= np.uint64(15) and -22 <= exponent <= 0:
                value = whole / _HIGH[_POWER_LIMIT - exponent]
            else:
                lost = False
                if digits > np.uint64(18):
                    whole, point_shift, lost = _read_long(data, number_at, number_end)
                    exponent = power + point_shift
                value, plain = _scale_decimal(whole, exponent, lost)
            out[count] = -value if negative else value
        if not plain:
            while at < end and not (data[at] == 32 or (9 <= data[at] <= 13)):
                at += one
            hard[hards, 0], hard[hards, 1], hard[hards, 2] = count, first, at
            hards += 1
        count += 1
        on_line += 1
    state[0], state[1], state[2], state[3], state[4] = at, count, hards, on_line, odd_lines


@kernel
def count_by_line(data, start, stop, out):
    """Write (line from ``start`` on, numbers on it) of every line that is not blank; return how many there are."""
    lines = 0
    line = 0
    on_line = 0
    inside = False
    for at in range(start, stop):
        byte = data[at]
        if byte == 10 or byte == 13:
            if on_line > 0:
                out[lines, 0], out[lines, 1] = line, on_line
                lines += 1
            on_line = 0
            if byte == 13 or at == start or data[at - 1] != 13:
                line += 1
            inside = False
        elif byte == 32 or (9 <= byte <= 13):
            inside = False
        elif not inside:
            inside = True
            on_line += 1
    if on_line > 0:
        out[lines, 0], out[lines, 1] = line, on_line
        lines += 1
    return lines


@kernel
def format_numbers(motion, start, stop, decimals, out):
    """Write rows ``start`` to ``stop`` as text with fixed decimals, one blank between numbers and a line feed a row.

    Numbers are rounded by their exact decimal value, half to even, as ``'%.6f'`` does; zero has no sign. All must
    be finite and smaller than 2**52 / 10**decimals. Places are unsigned, which spares a test for negative ones. Returns
    the number of bytes written to ``out``, which has room for three more.
    """
    columns = motion.shape[1]
    scale = np.int64(1)
    for _ in range(decimals):
        scale *= 10
    factor = float(scale)
    at = np.uint64(0)
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    for row in range(start, stop):
        for column in range(columns):
            signed = motion[row, column]
            value = abs(signed)
            product = value * factor
            number = np.int64(product)
            gap = product - number
            if gap == 0.5:
                # The product may have been rounded onto the half: what was lost decides.
                lost = _rounded_off(value, factor, product)
                number += lost > 0.0 or (lost == 0.0 and number % 2 == 1)
            else:
                number += gap > 0.5
            out[at] = 45
            at += np.uint64((signed < 0.0) & (number > 0))
            units = np.int64(value)
            part = number - units * scale
            carry = np.int64(part >= scale)
            units += carry
            part -= scale * carry
            if units < 1000:
                pick = np.uint64(4 * units)
                out[at], out[at + one], out[at + two] = _LEFT[pick], _LEFT[pick + one], _LEFT[pick + two]
                at += np.uint64(_LEFT[pick + three])
            else:
                digits = 4
                power = np.int64(10000)
                while units >= power:
                    power *= 10
                    digits += 1
                at += np.uint64(digits)
                place = at
                for _ in range(digits):
                    place -= one
                    rest = units // 10
                    out[place] = np.uint8(48 + units - rest * 10)
                    units = rest
            if decimals > 0:
                out[at] = 46
                at += np.uint64(decimals + 1)
                place = at
                left = decimals
                while left >= 2:
                    rest = part // 100
                    pick = np.uint64(2 * (part - rest * 100))
                    part = rest
                    place -= two
                    out[place], out[place + one] = _PAIRS[pick], _PAIRS[pick + one]
                    left -= 2
                if left > 0:
                    out[place - one] = np.uint8(48 + part)
            out[at] = 32
            at += one
        if columns > 0:
            at -= one
        out[at] = 10
        at += one
    return at
