"""Programs are read and executed: values, scopes, threads, errors, as the script manual has them."""

from __future__ import annotations

import socket

import pytest

from sims.ur._script_words import ScriptStream
from tests.sims.ur.conftest import PRIMARY, program


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ("textmsg(1 + 2 * 3 - 4 / 2)", "5"),
        ("textmsg((1 + 2) * 3 % 4)", "1"),
        ("textmsg(not 1 == 2 and True)", "True"),
        ("textmsg(True xor True or False)", "False"),
        ("x = [1, 2, 3]\ny = x\ny[1] = 5\ntextmsg(x[1] + y[1])", "7"),
        ("p = p[1, 2, 3, 0, 0, 0]\np[0] = p[0] * 2\ntextmsg(p)", "p[2, 2, 3, 0, 0, 0]"),
        ("textmsg(str_cat(\"a\", to_str(2)), str_sub('hello', 1, 3))", "a2ell"),
        ("textmsg(norm([3, 4]) + floor(1.9) + length([1, 1]))", "8"),
        ("textmsg(pose_trans(p[1, 0, 0, 0, 0, d2r(90)], p[1, 0, 0, 0, 0, 0])[1])", "1"),
        ("textmsg(pose_dist(pose_inv(p[1, 2, 2, 0, 0, 0]), p[0, 0, 0, 0, 0, 0]))", "3"),
        ("textmsg(binary_list_to_integer(integer_to_binary_list(13)))", "13"),
        ("textmsg(rpy2rotvec(rotvec2rpy([0.1, 0.2, 0.3])))", "[0.1, 0.2, 0.3]"),
        ("x =  # the value is on the next line\n  7\ntextmsg(x)", "7"),
    ],
)
def test_expressions(bench, body, text):
    assert bench().run(body) == [text]


def test_branches_loops_and_functions_with_defaults(bench):
    body = """
      def add(a, b=10):
        return a + b
      end
      i = 0
      n = 0
      while True:
        i = i + 1
        if i == 2:
          continue
        elif i > 5:
          break
        else:
          n = add(n, b=i)
        end
      end
      textmsg(n, add(1))
    """
    assert bench().run(body) == ["1311"]


def test_a_function_changes_the_program_s_variables_and_has_its_own(bench):
    body = """
      global count = 0
      inside = 1
      def step():
        count = count + 1
        inside = 2
        local count = 50
        own = 3
        count = count + own
        return count
      end
      textmsg(step(), count)
      textmsg(inside)
    """
    assert bench().run(body) == ["531", "2"]


def test_threads_run_beside_the_program_until_killed_or_joined(bench):
    body = """
      global n = 0
      thread count():
        while True:
          n = n + 1
          sync()
        end
      end
      thread once():
        sleep(0.01)
        n = n + 1000
      end
      t = run count()
      sleep(0.02)
      kill t
      textmsg(n > 5 and n < 12)
      n = 0
      sleep(0.01)
      join run once()
      textmsg(n)
    """
    assert bench().run(body) == ["True", "1000"]


def test_no_other_thread_runs_between_enter_and_exit_critical(bench):
    body = """
      global n = 0
      thread count():
        while True:
          n = n + 1
          sync()
        end
      end
      t = run count()
      enter_critical
      sleep(0.02)
      seen = n
      exit_critical
      sleep(0.02)
      textmsg(seen, n > 5)
    """
    assert bench().run(body) == ["0True"]


def test_a_thread_that_only_computes_goes_on_in_the_next_cycle(bench):
    begun = bench()
    body = "i = 0\nwhile i < 20000:\n i = i + 1\nend\ntextmsg(i)"
    started = begun.kernel.now
    assert begun.run(body) == ["20000"]
    assert begun.kernel.now - started >= 3 * begun.controller.cycle_ns


def test_halt_ends_the_program(bench):
    assert bench().run('textmsg("a")\nhalt\ntextmsg("b")') == ["a"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('def a():\n  textmsg("log ", get_actual_tcp_pose()\nend\n', "3: syntax_error_on_line:3:end:"),
        ("def a():\n  textmsg(get_tcp_pose())\nend\n", "2: compile_error_name_not_found:get_tcp_pose:"),
        ("def a():\n  x = 1 +\nend\n", "3: syntax_error_on_line:3:end:"),
        ("def a():\n  x = [1, 2]\n  y = x[2]\nend\n", "3: Index out of bounds: 2 of 2"),
        ("def a():\n  y = x\nend\n", "2: compile_error_name_not_found:x:"),
        ("def a():\n  y = 1 / 0\nend\n", "2: Division by zero"),
        ("def a():\n  movej([0, 0])\nend\n", "2: Type error: a list of six numbers is expected"),
        ("def a():\n  sleep()\nend\n", "2: Type error: sleep: missing a required argument: 't'"),
        ("def a():\n  y = True + 1\nend\n", "2: Type error: '+' is of two numbers"),
        ("def a():\n  tool_contact([0])\nend\n", "2: tool_contact is not simulated"),
        ("def a():\n  b()\nend\n", "2: compile_error_name_not_found:b:"),
        ("sec a():\n  sleep(1)\nend\n",
         "2: SECONDARY_PROGRAM_EXCEPTION_XXX a secondary program takes no time of the robot"),
        ("def a():\n  write_output_integer_register(48, 1)\nend\n",
         "2: Type error: write_output_integer_register: list assignment index out of range"),
    ],
)  # fmt: skip
def test_an_error_ends_the_program_and_names_its_line(bench, text, message):
    begun = bench()
    begun.controller.runtime.take(text)
    begun.until(lambda: not begun.controller.runtime.active)
    assert begun.log == [message]


def test_a_recursion_without_end_is_an_error(bench):
    begun = bench()
    assert begun.run("def f(x):\n return f(x + 1)\nend\nf(0)") == ["3: Stack overflow"]


def test_a_stream_is_cut_into_programs_however_it_comes():
    text = program("if True:\n sync()\nend", "a") + "\n# nothing\nset_digital_out(1, True)\nsec b():\n  sync()\nend\n"
    for size in (1, 7, len(text)):
        stream = ScriptStream()
        found = [one for i in range(0, len(text), size) for one in stream.feed(text[i : i + size].encode())]
        assert [one.split()[0] for one in found] == ["def", "set_digital_out(1,", "sec"]


def test_a_secondary_program_runs_beside_the_program(bench):
    begun = bench()
    begun.run("sleep(10)", seconds=0.1)
    client = begun.call(PRIMARY)
    client.sendall(b"sec out():\n  set_digital_out(2, True)\nend\n")
    begun.let_pass(0.1)
    assert begun.board.digital_out == 4
    assert begun.controller.runtime.active


def test_another_program_takes_the_place_of_the_one_that_runs(bench):
    begun = bench()
    begun.run("while True:\n sync()\nend", seconds=0.1, name="first")
    begun.run("while True:\n sync()\nend", seconds=0.1, name="second")
    assert begun.controller.runtime.machine.name == "second"


def test_a_program_talks_to_a_host_by_a_socket(bench):
    begun = bench()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        begun.run(
            f"""
              ok = socket_open("127.0.0.1", {port})
              socket_send_line("hello")
              textmsg(ok, socket_read_line())
              textmsg(socket_read_ascii_float(2))
              textmsg(socket_read_byte_list(3))
              textmsg(socket_read_line(timeout=0.1), "nothing")
              socket_close()
            """,
            seconds=0.05,
        )
        host, _ = listener.accept()
        with host:
            assert host.recv(100) == b"hello\n"
            host.sendall(b"you\n(1.5, 2)" + bytes([1, 2, 3]))
            begun.until(lambda: not begun.controller.runtime.active)
            assert begun.log == ["Trueyou", "[2, 1.5, 2]", "[3, 1, 2, 3]", "nothing"]
            assert host.recv(100) == b""


def test_a_socket_that_nobody_answers_is_false(bench):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    begun = bench()
    assert begun.run(f'textmsg(socket_open("127.0.0.1", {port}), socket_send_line("a"))') == ["FalseFalse"]
    assert begun.run('textmsg(socket_open("256.1.1.1", 80))') == ["False"]


def test_inputs_outputs_and_registers(bench):
    body = """
      set_standard_digital_out(1, True)
      set_configurable_digital_out(0, True)
      set_tool_digital_out(1, True)
      textmsg(get_standard_digital_out(1), get_digital_in(0))
      write_output_float_register(3, 2.5)
      write_output_boolean_register(64, True)
      write_output_integer_register(0, 3000000000)
      textmsg(read_output_float_register(3), read_output_integer_register(0))
      set_standard_analog_out(0, 0.5)
      set_tool_voltage(24)
    """
    begun = bench()
    assert begun.run(body) == ["TrueFalse", "2.5-1294967296"]
    assert begun.board.digital_out == 1 << 1 | 1 << 8 | 1 << 17
    assert (begun.board.analog_value(0), begun.board.tool_voltage) == (pytest.approx(0.012), 24)


def test_a_blocking_popup_holds_its_thread_until_it_is_closed(bench):
    begun = bench()
    assert begun.run('popup("wait", blocking=True)\ntextmsg("on")', seconds=0.1) == []
    assert begun.command("close popup") == "closing popup"
    begun.until(lambda: not begun.controller.runtime.active)
    assert begun.log == ["on"]


def test_payload_and_tcp_are_what_a_program_set(bench):
    body = """
      set_tcp(p[0, 0, 0.1, 0, 0, 0])
      set_payload(2.5)
      textmsg(get_target_payload(), get_target_payload_cog())
      set_target_payload(3, [0, 0, 0.05], [1, 2, 3, 0, 0, 0])
      textmsg(get_target_payload_inertia())
      textmsg(get_tcp_offset())
      textmsg(pose_dist(get_actual_tcp_pose(), get_actual_tool_flange_pose()))
    """
    assert bench().run(body) == ["2.5[0, 0, 0.1]", "[1, 2, 3, 0, 0, 0]", "p[0, 0, 0.1, 0, 0, 0]", "0.1"]


def test_inverse_kinematics_is_that_of_the_forward_one(bench):
    body = """
      q = [0.3, -1.2, 1.4, -1, -1.5, 0.2]
      x = get_forward_kin(q, p[0, 0, 0.1, 0, 0, 0])
      back = get_inverse_kin(x, [0, -1, 1, -1, -1, 0], tcp=p[0, 0, 0.1, 0, 0, 0])
      textmsg(norm([back[0] - q[0], back[1] - q[1], back[2] - q[2], back[3] - q[3], back[4] - q[4]]) < 1e-8)
      textmsg(get_inverse_kin_has_solution(p[5, 0, 0, 0, 0, 0]))
      textmsg(is_within_safety_limits([0, 0, 0, 0, 0, 7]), is_within_safety_limits(q))
      textmsg(get_inverse_kin(p[5, 0, 0, 0, 0, 0]))
    """
    log = bench().run(body)
    assert log[:3] == ["True", "False", "FalseTrue"]
    assert log[3] == "8: get_inverse_kin: unable to find an inverse kinematics solution"


def test_the_state_of_the_arm_as_a_program_reads_it(bench):
    body = """
      textmsg(get_steptime(), is_steady())
      textmsg(pose_dist(get_actual_tcp_pose(), get_target_tcp_pose()) < 1e-4)
      textmsg(norm(get_actual_joint_speeds()) + norm(get_target_joint_speeds()))
      textmsg(norm(get_target_joint_accelerations()))
      textmsg(norm(get_actual_tcp_speed()) + norm(get_target_tcp_speed()) + norm(get_tcp_force()) + force())
      q = get_actual_joint_positions()
      r = get_target_joint_positions()
      textmsg(q[1] - r[1] < 0.001)
    """
    assert bench().run(body) == ["0.002True", "True", "0", "0", "0", "True"]


def test_the_history_of_joints(bench):
    body = """
      speedj([0.1, 0, 0, 0, 0, 0], 10, t=0.2)
      now = get_actual_joint_positions_history(0)
      then = get_actual_joint_positions_history(10)
      oldest = get_actual_joint_positions_history(100000)
      textmsg(now[0] - then[0] > 0.0019 and now[0] - then[0] < 0.0021, oldest[0])
    """
    assert bench(errors={}).run(body) == ["True0"]
