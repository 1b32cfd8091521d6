# SPDX-License-Identifier: Apache-2.0
"""Moves of the soliton that the page asks for, and those that it only shows."""

from __future__ import annotations

from typing import Any

from live_stage import Stage, Visit, until
from rclpy.action import ActionClient

from soliton_linkage_msgs.action import MoveSoliton


def test_a_click_carries_the_soliton_there_and_it_is_let_go(at_rest: Visit, view: Any) -> None:
    visit = at_rest
    visit.page.mouse.click(*visit.place(7.0))
    visit.page.locator('#live-move progress').wait_for()
    visit.wait('Math.abs(live.shown.goal - 7) < 0.06')
    visit.shot('move')
    visit.page.reload()
    visit.wait('window.live && live.drawn > 2')
    energies = visit.js('live.track(0).energies.map((s) => s.filter(Number.isFinite).length)')
    assert min(energies) > 10
    move = view.commands('/').move
    # On a busy machine it may have ended before the page is there again.
    shown = 'document.getElementById("live-move").textContent'
    visit.wait(f'{shown}.includes("rotor 7.0") || {shown}.includes("reached")')
    until(lambda: not move.under_way, 'the end of the move')
    assert move.state == 'reached'
    visit.says('move', 'reached')
    visit.click('release')
    visit.told('let go')


def test_a_move_is_cancelled_and_one_out_of_the_chain_is_told_in_words(
    at_rest: Visit, view: Any
) -> None:
    visit = at_rest
    visit.page.focus('#live-chain')
    for _ in range(3):
        visit.page.keyboard.press('ArrowRight')
    visit.page.keyboard.press('Enter')
    until(lambda: view.commands('/').move.under_way, 'the move')
    visit.click('cancel')
    until(lambda: view.commands('/').move.state == 'cancelled', 'the cancellation')
    visit.says('move', 'cancelled')
    visit.fill('to rotor', 40)
    visit.click('carry')
    visit.says('move', 'out of the chain')
    visit.click('release')
    visit.page.focus('#live-chain')
    visit.page.keyboard.press('Escape')


def test_a_move_that_was_asked_for_elsewhere_is_shown_and_cancelled(
    at_rest: Visit, view: Any, stage: Stage
) -> None:
    visit = at_rest
    client = ActionClient(stage.user, MoveSoliton, 'move_soliton')
    until(client.server_is_ready, 'the steering')
    goal = MoveSoliton.Goal(rotor=9.0, speed=0.5)
    sent = client.send_goal_async(goal)
    visit.says('move', 'carrying to rotor 9.00, as asked for elsewhere')
    visit.wait('live.shown.goal === 9')
    visit.wait('document.querySelector("#live-move progress").value > 0.05')
    visit.click('cancel')
    visit.says('move', 'stopped: ')
    until(sent.done, 'the answer')
    ended = sent.result().get_result_async()
    until(ended.done, 'the result')
    assert ended.result().result.outcome == MoveSoliton.Result.CANCELLED
    visit.click('release')
    client.destroy()
