# SPDX-License-Identifier: Apache-2.0
from programs import until
from rclpy.action import ActionClient

from soliton_linkage_msgs.action import MoveSoliton
from soliton_linkage_nodes.runtime import interfaces


def test_a_click_moves_the_soliton_and_release_ends_the_hold(at_rest, view):
    visit = at_rest
    for name in ('cancel', 'release'):
        visit.page.locator(f'#live-{name}[disabled]').wait_for()
    visit.page.mouse.click(*visit.place(7.0))
    visit.page.locator('#live-move progress').wait_for()
    visit.wait('Math.abs(live.shown.goal - 7) < 0.06')
    visit.page.reload()
    visit.wait('window.live && live.drawn > 2')
    energies = visit.js('live.track(0).energies.map((s) => s.filter(Number.isFinite).length)')
    assert min(energies) > 10
    move = view.commands('/').move
    # The move may end before the page is loaded again.
    shown = 'document.getElementById("live-move").textContent'
    visit.wait(f'{shown}.includes("rotor 7.0") || {shown}.includes("reached")')
    until(lambda: not move.under_way, 'the end of the move')
    assert move.state == 'reached'
    visit.has_text('move', 'reached')
    visit.page.locator('#live-cancel[disabled]').wait_for()
    visit.click('release')
    visit.answers('released')
    visit.page.locator('#live-release[disabled]').wait_for()


def test_a_move_is_cancelled_a_goal_outside_is_rejected_and_a_reset_ends_the_status(at_rest, view):
    visit = at_rest
    visit.page.focus('#live-chain')
    for _ in range(3):
        visit.page.keyboard.press('ArrowRight')
    visit.page.keyboard.press('Enter')
    until(lambda: view.commands('/').move.under_way, 'the move')
    visit.click('cancel')
    until(lambda: view.commands('/').move.state == 'cancelled', 'the cancellation')
    visit.has_text('move', 'cancelled')
    visit.fill('to rotor', 40)
    visit.click('carry')
    visit.answers('outside the chain: ')
    assert view.commands('/').move.state == 'cancelled'
    visit.tab('Run')
    visit.click('reset')
    visit.wait('document.getElementById("live-move").textContent === ""')
    assert not view.commands('/').move.state
    visit.page.focus('#live-chain')
    visit.page.keyboard.press('Escape')


def test_a_pull_releases_the_held_soliton(at_rest, view, stage):
    visit = at_rest
    visit.fill('to rotor', 6)
    visit.click('carry')
    visit.has_text('move', 'reached: ')
    x, y = visit.mass(9)
    visit.page.mouse.move(x, y)
    visit.page.mouse.down()
    visit.page.mouse.move(x + 15, y + 15, steps=3)
    visit.wait('document.getElementById("live-move").textContent === ""')
    visit.page.locator('#live-release[disabled]').wait_for()
    torques = stage.record(interfaces.ROTOR_TORQUES)
    until(lambda: torques and any(torques[-1].effort), 'the torque of the pull')
    visit.page.mouse.up()
    visit.tells_effect('rotor_9')
    assert not view.commands('/').holding


def test_a_move_of_another_client_is_shown_and_cancelled(at_rest, view, stage):
    visit = at_rest
    client = ActionClient(stage.user, MoveSoliton, 'move_soliton')
    until(client.server_is_ready, 'the steering')
    goal = MoveSoliton.Goal(rotor=9.0, speed=0.5)
    sent = client.send_goal_async(goal)
    visit.has_text('move', 'moving the soliton to rotor 9.00, requested by another program')
    visit.wait('live.shown.goal === 9')
    visit.wait('document.querySelector("#live-move progress").value > 0.05')
    visit.click('cancel')
    visit.answers('stopped: ')
    until(sent.done, 'the answer')
    ended = sent.result().get_result_async()
    until(ended.done, 'the result')
    assert ended.result().result.outcome == MoveSoliton.Result.CANCELLED
    visit.click('release')
    client.destroy()
