"""Export of agents and rules to controllers without Python.

A policy becomes C source, an ONNX model (agents only), or a table of its numbers for JSON.

An ONNX model is a message of Protocol Buffers. This module encodes the few fields that a network
needs, without a package for ONNX (fields and numbers from onnx.proto3,
https://github.com/onnx/onnx, ONNX 1.19, opset 13).
"""

import struct
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_env.checks import require
from optimisation.rl import rules
from optimisation.rl.agents import Agent
from optimisation.rl.families import ConstantAction, FamilyPolicy, task_of

OPSET = 13
IR_VERSION = 8
TABLE_FORMAT = 1
FLOAT = 1  # types of ONNX tensors
INT64 = 7
NUMBERS_PER_LINE = 8  # of C source
PREFIX = "impact_agent"  # of the names in C source


# What is exported


def describe_observation(env_id: str, arguments: Any = None) -> list[dict[str, Any]]:
    """Return a dict for each component of an environment's observation, in order.

    Keys: ``name``, ``what`` (meaning), ``unit``, and ``measured``, whether a sensor gives it.
    ``arguments``: those of the environment; None: defaults.
    """
    task = task_of(env_id, arguments)
    words = {
        "few": "",
        "origin": f"{task.schedule.frequency_origin:g}",
        "scale": f"{task.schedule.frequency_unit:g}",
        "level": "reference",
    }
    return [
        {
            "name": feature.name,
            "what": feature.what.format(**words),
            "unit": feature.unit.format(**words),
            "measured": feature.measured,
        }
        for feature in task.features
    ]


def make_table(policy: Agent | FamilyPolicy, env_id: str) -> dict[str, Any]:
    """Return a policy as plain data for JSON.

    The data have the observation's components, and either weights and biases of the layers and the
    memory (an LSTM cell), or the numbers of a rule by name.
    """
    table: dict[str, Any] = {
        "format": TABLE_FORMAT,
        "environment": env_id,
        "policy": policy.name,
        "observation": describe_observation(
            env_id, policy.arguments if isinstance(policy, Agent) else None
        ),
    }
    if isinstance(policy, FamilyPolicy):
        (numbers,) = policy.parameters.tolist()
        names = policy.family.names
        return table | {
            "family": type(policy.family).__name__,
            "numbers": dict(zip(names, numbers, strict=True)),
        }
    table |= {"activation": policy.activation, "squash": policy.squash}
    if policy.cells is not None:
        names = ("weights_of_inputs", "weights_of_outputs", "biases")
        table["memory"] = {
            name: part.tolist() for name, part in zip(names, policy.cells, strict=True)
        } | {"gates": ["input", "forget", "cell", "output"]}
    table["layers"] = [
        {"weights": weights.tolist(), "biases": biases.tolist()}
        for weights, biases in policy.layers
    ]
    return table


# C source


def _format_array(name: str, values: NDArray[Any], single: bool = True) -> str:
    """Return the C definition of a constant array, row after row, as float or double.

    ``single``: float.
    """
    number, suffix = (np.float32, "f") if single else (np.float64, "")
    # the shortest constants that give the same floats or doubles
    texts = [
        np.format_float_scientific(number(value)) + suffix for value in np.ravel(values).tolist()
    ]
    lines = [
        "    " + ", ".join(texts[k : k + NUMBERS_PER_LINE])
        for k in range(0, len(texts), NUMBERS_PER_LINE)
    ]
    kind = "float" if single else "double"
    body = ",\n".join(lines)
    return f"static const {kind} {name}[{len(texts)}] = {{\n{body}\n}};\n"


def _describe_in_c(policy: Agent | FamilyPolicy, env_id: str) -> str:
    """Return the comment on the observation's components at the beginning of C source."""
    arguments = policy.arguments if isinstance(policy, Agent) else None
    rows = [
        f" *   {k:2d}  {row['what']} [{row['unit']}]"
        for k, row in enumerate(describe_observation(env_id, arguments))
    ]
    return "\n".join(
        [
            f"/* {policy.name}, {env_id}.",
            " *",
            f" * {PREFIX}_act computes the action, each number from -1 to 1, from the observation:",
            *rows,
            " */",
            "#include <math.h>",
            "",
        ]
    )


C_DENSE = """
static void dense(const float *weights, const float *biases, int inputs, int outputs,
                  const float *from, float *to)
{
    for (int i = 0; i < outputs; i++) {
        float sum = 0.0f;
        for (int j = 0; j < inputs; j++)
            sum += weights[i * inputs + j] * from[j];
        to[i] = sum + biases[i];
    }
}
"""
C_SIGMOID = """
static float sigmoid(float x)
{
    return 0.5f * (tanhf(0.5f * x) + 1.0f);
}
"""
C_ACTIVATIONS = {"tanh": "tanhf({0})", "relu": "{0} > 0.0f ? {0} : 0.0f"}
C_SQUASHES = {
    "clip": "{0} > 1.0f ? 1.0f : {0} < -1.0f ? -1.0f : {0}",
    "tanh": "tanhf({0})",
}


def _write_agent_in_c(agent: Agent, env_id: str) -> str:
    """Return the C source of an agent's network in single precision."""
    first_inputs = agent.layers[0][0].shape[1] if agent.cells is None else agent.cells[0].shape[1]
    outputs = agent.layers[-1][0].shape[0]
    widest = max(weights.shape[0] for weights, _ in agent.layers)
    parts = [_describe_in_c(agent, env_id)]
    for k, (weights, biases) in enumerate(agent.layers):
        parts += [_format_array(f"weights{k}", weights), _format_array(f"biases{k}", biases)]
    parts.append(C_DENSE)
    arguments = f"const float observation[{first_inputs}], float action[{outputs}]"
    body = []
    source = "observation"
    if agent.cells is not None:
        inputs, recurrent, biases = agent.cells
        size = recurrent.shape[1]
        parts += [
            _format_array("memory_inputs", inputs),
            _format_array("memory_outputs", recurrent),
            _format_array("memory_biases", biases),
            C_SIGMOID,
            f"""
/* memory of one machine: zero at the start of an episode */
typedef struct {{
    float output[{size}];
    float state[{size}];
}} {PREFIX}_memory;
""",
        ]
        arguments = f"{PREFIX}_memory *memory, {arguments}"
        body.append(
            f"""    float gates[{4 * size}], own[{4 * size}];
    static const float zeros[{4 * size}] = {{0.0f}};
    dense(memory_inputs, memory_biases, {first_inputs}, {4 * size}, observation, gates);
    dense(memory_outputs, zeros, {size}, {4 * size}, memory->output, own);
    for (int i = 0; i < {4 * size}; i++)
        gates[i] += own[i];
    for (int i = 0; i < {size}; i++) {{
        memory->state[i] = sigmoid(gates[{size} + i]) * memory->state[i]
                         + sigmoid(gates[i]) * tanhf(gates[{2 * size} + i]);
        memory->output[i] = sigmoid(gates[{3 * size} + i]) * tanhf(memory->state[i]);
    }}
"""
        )
        source = "memory->output"
    body.append(f"    float here[{widest}], next[{widest}];\n")
    for k, (weights, _) in enumerate(agent.layers):
        rows, columns = weights.shape
        last = k + 1 == len(agent.layers)
        form = C_SQUASHES[agent.squash] if last else C_ACTIVATIONS[agent.activation]
        target = "action" if last else "here"
        body.append(
            f"""    dense(weights{k}, biases{k}, {columns}, {rows}, {source}, next);
    for (int i = 0; i < {rows}; i++)
        {target}[i] = {form.format("next[i]")};
"""
        )
        source = "here"
    parts.append(f"\nvoid {PREFIX}_act({arguments})\n{{\n{''.join(body)}}}\n")
    return "".join(parts)


# formulas of the rules, equal to their families' in Python; p: numbers of the rule, o: observation,
# a: action before it is clipped
C_SIZE = f"""    const double size = fmax(o[{rules.RMS}], 0.0) + {rules.SMALL!r};
    const double log_size = log(size), per_square = 1.0 / (size * size);
"""
C_RULES: dict[type, str] = {
    ConstantAction: """    (void)o;
    for (int i = 0; i < {numbers}; i++)
        a[i] = p[i];
""",
    rules.Switch: C_SIZE
    + f"""    const double pi = 3.14159265358979323846;
    const double power = o[{rules.W}] * per_square
        * (o[{rules.V}] * cos(pi * p[2]) + o[{rules.X}] * sin(pi * p[2]));
    a[0] = p[0] + p[1] * tanh(exp(p[6]) * power) + p[3] * log_size + p[4] * o[{rules.RATIO}]
         + p[5] * o[{rules.LEFT}] + p[7] * (fabs(o[{rules.R}]) - 0.5);
""",
    rules.Phase: C_SIZE
    + f"""    const double pi = 3.14159265358979323846;
    const double angle = 2.0 * atan2(o[{rules.SIN}], o[{rules.COS}])
        + pi * (p[2] + p[6] * o[{rules.RATIO}]);
    (void)per_square;
    a[0] = p[0] + (p[1] + p[7] * log_size) * sin(angle) + p[3] * log_size
         + p[4] * o[{rules.RATIO}] + p[5] * o[{rules.LEFT}];
""",
    rules.Products: C_SIZE
    + f"""    a[0] = p[0] + p[1] * log_size + p[2] * o[{rules.V}] * o[{rules.W}] * per_square
         + p[3] * o[{rules.R}] * o[{rules.W}] + p[4] * o[{rules.X}] * o[{rules.W}] * per_square
         + p[5] * o[{rules.X}] * o[{rules.R}] * per_square + p[6] * o[{rules.RATIO}]
         + p[7] * o[{rules.LEFT}];
""",
    rules.SideAndSlip: C_SIZE
    + f"""    const double pi = 3.14159265358979323846;
    const double side = tanh(2.0 * o[{rules.R}]) / size
        * (o[{rules.X}] * cos(pi * p[4]) + o[{rules.V}] * sin(pi * p[4]));
    const double along = tanh(4.0 * o[{rules.W}] / size) / size
        * (o[{rules.X}] * cos(pi * p[10]) + o[{rules.V}] * sin(pi * p[10]));
    (void)per_square;
    a[0] = p[0] + p[1] * log_size + p[2] * log_size * log_size
         + (p[3] + p[6] * log_size) * tanh(exp(p[5]) * side)
         + (p[7] + p[8] * log_size) * tanh(fabs(o[{rules.W}]) / size)
         + p[9] * along + p[11] * o[{rules.LEFT}];
""",
    rules.PairBySize: f"""    const double size = fmax(o[{rules.PAIR_SIZE}], 0.0);
    const double log_size = log(size + {rules.SMALL!r});
    const double other = fabs(o[{{feature}}]);
    a[0] = p[0] + p[1] * log_size + p[4] * o[{rules.PAIR_RATIO}] + p[6] * other;
    a[1] = p[2] + p[3] * log_size + p[5] * o[{rules.PAIR_RATIO}] + p[7] * other;
""",
}


def _write_rule_in_c(policy: FamilyPolicy, env_id: str) -> str:
    """Return the C source of a rule in double precision.

    Raises ParameterError for a family without a formula in `C_RULES`.
    """
    family = policy.family
    form = next((form for kind, form in C_RULES.items() if isinstance(family, kind)), None)
    known = ", ".join(kind.__name__ for kind in C_RULES)
    require(form is not None, "policy", policy.name, f"a rule without memory: {known}")
    assert form is not None
    require(len(policy.parameters) == 1, "policy", policy.name, "a rule with one row of numbers")
    features = len(describe_observation(env_id))
    numbers = 2 if isinstance(family, rules.PairBySize) else 1
    if isinstance(family, ConstantAction):
        numbers = len(family.names)
    feature = getattr(family, "feature", 0)
    names = "".join(f" *   {k}  {name}\n" for k, name in enumerate(family.names))
    return (
        _describe_in_c(policy, env_id)
        + f"\n/* numbers of the rule:\n{names} */\n"
        + _format_array("p", policy.parameters[0], single=False)
        + f"\nvoid {PREFIX}_act(const float o[{features}], float action[{numbers}])\n{{\n"
        + f"    double a[{numbers}];\n"
        + form.format(numbers=numbers, feature=feature)
        + f"""    for (int i = 0; i < {numbers}; i++)
        action[i] = (float)(a[i] > 1.0 ? 1.0 : a[i] < -1.0 ? -1.0 : a[i]);
}}
"""
    )


def write_c(policy: Agent | FamilyPolicy, env_id: str) -> str:
    """Return C source with a function ``impact_agent_act`` that computes the actions of a policy.

    The source is C99 and needs only the mathematical library. An agent computes in single
    precision, a rule in double. For an agent with memory the function's first argument is a pointer
    to the memory, a structure that must be zero at the start of an episode. Raises ParameterError
    for a rule with memory.
    """
    if isinstance(policy, Agent):
        return _write_agent_in_c(policy, env_id)
    return _write_rule_in_c(policy, env_id)


# ONNX


def _encode_integer(value: int) -> bytes:
    """Return an integer, 0 or more, as a varint of Protocol Buffers."""
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


def _encode_field(number: int, value: int | float | str | bytes) -> bytes:
    """Return the encoded field ``number`` of a message.

    An integer is a varint, a float has 32 bits, and text, bytes or an encoded message follow their
    length.
    """
    if isinstance(value, int):
        return _encode_integer(number << 3) + _encode_integer(value)
    if isinstance(value, float):
        return _encode_integer(number << 3 | 5) + struct.pack("<f", value)
    content = value.encode() if isinstance(value, str) else value
    return _encode_integer(number << 3 | 2) + _encode_integer(len(content)) + content


def _encode_message(fields: Iterable[tuple[int, int | float | str | bytes]]) -> bytes:
    """Return an encoded message of fields (number, value)."""
    return b"".join(_encode_field(number, value) for number, value in fields)


def _make_tensor(name: str, values: NDArray[Any]) -> bytes:
    """Return an encoded TensorProto: int64 for integers, otherwise 32-bit floats."""
    whole = values.dtype.kind == "i"
    content = np.ascontiguousarray(values, dtype="<i8" if whole else "<f4").tobytes()
    dims = [(1, size) for size in values.shape]
    return _encode_message([*dims, (2, INT64 if whole else FLOAT), (8, name), (9, content)])


def _make_node(
    kind: str, inputs: Sequence[str], outputs: Sequence[str], **attributes: int
) -> bytes:
    """Return an encoded NodeProto of the operator ``kind``, named after its first output.

    ``attributes`` are integers.
    """
    return _encode_message(
        [
            *((1, name) for name in inputs),
            *((2, name) for name in outputs),
            (3, f"compute {outputs[0]}"),
            (4, kind),
            *(
                (5, _encode_message([(1, name), (3, value), (20, 2)]))  # type 2: integer
                for name, value in attributes.items()
            ),
        ]
    )


def _make_value(name: str, size: int) -> bytes:
    """Return an encoded ValueInfoProto: 32-bit floats (lanes, size), lanes of any number."""
    lanes = _encode_message([(2, "lanes")])
    columns = _encode_message([(1, size)])
    shape = _encode_message([(1, lanes), (1, columns)])
    tensor = _encode_message([(1, FLOAT), (2, shape)])
    return _encode_message([(1, name), (2, _encode_message([(1, tensor)]))])


def _add_memory(agent: Agent, nodes: list[bytes], constants: list[bytes]) -> None:
    """Append the nodes and constants of an agent's memory (an LSTM cell) to the two lists.

    They compute ``output`` and ``state`` from ``observation``, ``output before`` and
    ``state before``.
    """
    assert agent.cells is not None
    inputs, recurrent, biases = agent.cells
    constants += [
        _make_tensor("memory inputs", inputs),
        _make_tensor("memory outputs", recurrent),
        _make_tensor("memory biases", biases),
    ]
    gates = ("takes", "keeps", "new", "shows")
    nodes += [
        _make_node("Gemm", ["observation", "memory inputs", "memory biases"], ["seen"], transB=1),
        _make_node("Gemm", ["output before", "memory outputs", "seen"], ["gates"], transB=1),
        _make_node("Split", ["gates"], gates, axis=1),
        *(_make_node("Sigmoid", [name], [f"gate {name}"]) for name in ("takes", "keeps", "shows")),
        _make_node("Tanh", ["new"], ["candidate"]),
        _make_node("Mul", ["gate keeps", "state before"], ["state that stays"]),
        _make_node("Mul", ["gate takes", "candidate"], ["state that is added"]),
        _make_node("Add", ["state that stays", "state that is added"], ["state"]),
        _make_node("Tanh", ["state"], ["limited state"]),
        _make_node("Mul", ["gate shows", "limited state"], ["output"]),
    ]


def write_onnx(agent: Agent) -> bytes:
    """Return an ONNX model, encoded, that computes an agent's actions from observations.

    The input ``observation`` (lanes, features) and the output ``action`` (lanes, A) are 32-bit
    floats.

    An agent with memory also takes ``output before`` and ``state before`` (lanes, H), zero at the
    start of an episode, and returns ``output`` and ``state`` for the next call.
    """
    nodes: list[bytes] = []
    constants: list[bytes] = []
    features = (agent.layers[0][0] if agent.cells is None else agent.cells[0]).shape[1]
    inputs = [_make_value("observation", features)]
    outputs = [_make_value("action", agent.layers[-1][0].shape[0])]
    source = "observation"
    if agent.cells is not None:
        size = agent.cells[1].shape[1]
        inputs += [_make_value("output before", size), _make_value("state before", size)]
        outputs += [_make_value("output", size), _make_value("state", size)]
        _add_memory(agent, nodes, constants)
        source = "output"
    for k, (weights, biases) in enumerate(agent.layers):
        last = k + 1 == len(agent.layers)
        kind = agent.squash if last else agent.activation
        constants += [
            _make_tensor(f"weights {k}", weights),
            _make_tensor(f"biases {k}", biases),
        ]
        nodes.append(
            _make_node("Gemm", [source, f"weights {k}", f"biases {k}"], [f"sum {k}"], transB=1)
        )
        target = "action" if last else f"layer {k}"
        if kind == "clip":
            constants += [
                _make_tensor("lowest", np.array(-1.0)),
                _make_tensor("highest", np.array(1.0)),
            ]
            nodes.append(_make_node("Clip", [f"sum {k}", "lowest", "highest"], [target]))
        else:
            nodes.append(_make_node(kind.capitalize(), [f"sum {k}"], [target]))
        source = target
    graph = _encode_message(
        [
            *((1, node) for node in nodes),
            (2, agent.env_id),
            *((5, constant) for constant in constants),
            *((11, value) for value in inputs),
            *((12, value) for value in outputs),
        ]
    )
    return _encode_message(
        [
            (1, IR_VERSION),
            (2, "impact-absorber-workbench"),
            (7, graph),
            (8, _encode_message([(1, ""), (2, OPSET)])),
        ]
    )
