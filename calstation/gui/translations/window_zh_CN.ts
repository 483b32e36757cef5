<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>ChecksTable</name>
    <message>
        <source>Check</source>
        <translation>检查项</translation>
    </message>
    <message>
        <source>Where</source>
        <translation>位置</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>Value</source>
        <translation>值</translation>
    </message>
    <message>
        <source>Limit</source>
        <translation>限差</translation>
    </message>
    <message>
        <source>Margin</source>
        <translation>余量</translation>
    </message>
    <message>
        <source>Verdict</source>
        <translation>结论</translation>
    </message>
    <message>
        <source>Checks of the result</source>
        <translation>结果的检查项</translation>
    </message>
</context>
<context>
    <name>ComparisonTable</name>
    <message>
        <source>unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>diff.</source>
        <translation>差值</translation>
    </message>
    <message>
        <source>in σ</source>
        <translation>差值/σ</translation>
    </message>
</context>
<context>
    <name>EndStageButton</name>
    <message>
        <source>End stage</source>
        <translation>结束本阶段</translation>
    </message>
    <message>
        <source>After this move: solve, then go on</source>
        <translation>本次转动后结束：解算，然后继续</translation>
    </message>
</context>
<context>
    <name>ExchangeLabel</name>
    <message>
        <source>1 run waits for the database</source>
        <translation>1 条标定记录等待发送到数据库</translation>
    </message>
    <message>
        <source>{0} runs wait for the database</source>
        <translation>{0} 条标定记录等待发送到数据库</translation>
    </message>
    <message>
        <source>{0} runs wait for the database since {1}</source>
        <translation>{0} 条标定记录自 {1} 起等待发送到数据库</translation>
    </message>
    <message>
        <source>1 run waits for the database since {1}</source>
        <translation>1 条标定记录自 {1} 起等待发送到数据库</translation>
    </message>
    <message>
        <source>1 log waits for the archive</source>
        <translation>1 份数据记录等待归档</translation>
    </message>
    <message>
        <source>{0} logs wait for the archive</source>
        <translation>{0} 份数据记录等待归档</translation>
    </message>
</context>
<context>
    <name>FileExport</name>
    <message>
        <source>The export failed</source>
        <translation>导出失败</translation>
    </message>
    <message>
        <source>Written</source>
        <translation>已写入</translation>
    </message>
</context>
<context>
    <name>JobRow</name>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>waiting for other work</source>
        <translation>等待其他任务完成</translation>
    </message>
    <message>
        <source>{0} left</source>
        <translation>剩余 {0}</translation>
    </message>
</context>
<context>
    <name>MainWindow</name>
    <message>
        <source>STOP</source>
        <translation>停止</translation>
    </message>
    <message>
        <source>Stops the run safely; Esc does the same. It is no emergency stop.</source>
        <translation>安全停止本次标定，按 Esc 键同样有效。这不是急停按钮。</translation>
    </message>
    <message>
        <source>Light or dark</source>
        <translation>浅色或深色</translation>
    </message>
    <message>
        <source>Engineer</source>
        <translation>工程师</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Offline</source>
        <translation>离线解算</translation>
    </message>
    <message>
        <source>History</source>
        <translation>历史记录</translation>
    </message>
    <message>
        <source>Quality</source>
        <translation>质量</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Lock: back to the operator&apos;s role</source>
        <translation>锁定，回到操作员身份</translation>
    </message>
    <message>
        <source>Unlock with the engineer&apos;s PIN</source>
        <translation>用工程师密码解锁</translation>
    </message>
    <message>
        <source>no station</source>
        <translation>无工位</translation>
    </message>
    <message>
        <source>virtual bench</source>
        <translation>虚拟台架</translation>
    </message>
    <message>
        <source>Table and unit are simulated: nothing moves.</source>
        <translation>转台和产品均为模拟，设备不会实际运动。</translation>
    </message>
</context>
<context>
    <name>MissingState</name>
    <message>
        <source>Add this state and solve again</source>
        <translation>加入该状态重新解算</translation>
    </message>
    <message>
        <source>Solves the stored log; nothing is stored or written to the unit</source>
        <translation>解算已存数据记录；不保存结果，也不写入产品</translation>
    </message>
</context>
<context>
    <name>NoticeBar</name>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
</context>
<context>
    <name>ParameterTable</name>
    <message>
        <source>Copy</source>
        <translation>复制</translation>
    </message>
    <message>
        <source>Save as CSV…</source>
        <translation>另存为 CSV…</translation>
    </message>
    <message>
        <source>Save the table</source>
        <translation>保存表格</translation>
    </message>
</context>
<context>
    <name>PeoplePanel</name>
    <message>
        <source>Confirm</source>
        <translation>确认</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>Confirmation</source>
        <translation>确认</translation>
    </message>
    <message>
        <source>Fill in every field</source>
        <translation>请填写所有栏目</translation>
    </message>
    <message>
        <source>Reason</source>
        <translation>理由</translation>
    </message>
    <message>
        <source>Your badge</source>
        <translation>您的工牌</translation>
    </message>
    <message>
        <source>Your name</source>
        <translation>您的姓名</translation>
    </message>
    <message>
        <source>Your PIN</source>
        <translation>您的 PIN 码</translation>
    </message>
    <message>
        <source>Second engineer&apos;s badge</source>
        <translation>第二位工程师的工牌</translation>
    </message>
    <message>
        <source>Second engineer&apos;s PIN</source>
        <translation>第二位工程师的 PIN 码</translation>
    </message>
</context>
<context>
    <name>PlotMenu</name>
    <message>
        <source>Copy as picture</source>
        <translation>复制为图片</translation>
    </message>
    <message>
        <source>Save…</source>
        <translation>保存…</translation>
    </message>
    <message>
        <source>Save the plot</source>
        <translation>保存图形</translation>
    </message>
</context>
<context>
    <name>ReleaseBar</name>
    <message>
        <source>Release the unit…</source>
        <translation>放行产品…</translation>
    </message>
    <message>
        <source>Let the unit be used although it failed; the run stays FAIL</source>
        <translation>允许使用不合格的产品；该次标定仍为不合格</translation>
    </message>
    <message>
        <source>Release unit {0} although it failed?</source>
        <translation>产品 {0} 不合格，仍要放行吗？</translation>
    </message>
</context>
<context>
    <name>ResetBar</name>
    <message>
        <source>Reset the fault</source>
        <translation>复位故障</translation>
    </message>
    <message>
        <source>A run is going on; reset when it has ended.</source>
        <translation>标定正在进行，结束后再复位。</translation>
    </message>
    <message>
        <source>Clears what the table has latched. Nothing moves and no axis is switched on.</source>
        <translation>清除转台锁存的故障。转台不会转动，轴也不会上电。</translation>
    </message>
    <message>
        <source>Asking the table.</source>
        <translation>正在询问转台。</translation>
    </message>
</context>
<context>
    <name>RolePanel</name>
    <message>
        <source>Choose the engineer&apos;s PIN</source>
        <translation>设置工程师密码</translation>
    </message>
    <message>
        <source>Engineer</source>
        <translation>工程师</translation>
    </message>
    <message>
        <source>No PIN has been set here yet. At least four characters; it opens what changes results.</source>
        <translation>本机还没有设置密码。至少四个字符，用来开放会影响结果的设置。</translation>
    </message>
    <message>
        <source>The PIN opens settings that change results, and registers.</source>
        <translation>密码开放会影响结果的设置和寄存器操作。</translation>
    </message>
    <message>
        <source>new PIN</source>
        <translation>新密码</translation>
    </message>
    <message>
        <source>PIN</source>
        <translation>密码</translation>
    </message>
    <message>
        <source>The two PINs differ.</source>
        <translation>两次输入不一致。</translation>
    </message>
    <message>
        <source>the same again</source>
        <translation>再输一遍</translation>
    </message>
    <message>
        <source>Set PIN</source>
        <translation>设置密码</translation>
    </message>
    <message>
        <source>Unlock</source>
        <translation>解锁</translation>
    </message>
    <message>
        <source>Cancel</source>
        <translation>取消</translation>
    </message>
    <message>
        <source>The PIN is wrong.</source>
        <translation>密码不对。</translation>
    </message>
    <message>
        <source>Wait {seconds:.0f} s.</source>
        <translation>请等 {seconds:.0f} 秒。</translation>
    </message>
</context>
<context>
    <name>RunStrip</name>
    <message>
        <source>{time} left</source>
        <translation>剩余 {time}</translation>
    </message>
</context>
</TS>
